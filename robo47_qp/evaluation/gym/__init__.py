"""Tasks as environments of Gymnasium."""
