"""The motion types, one file each."""
