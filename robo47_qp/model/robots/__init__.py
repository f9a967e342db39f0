"""Robot descriptions, one module each."""
