"""An arm that follows a target which a person moves, or a recorded hand path."""
