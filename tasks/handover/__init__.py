"""Hand an item from one arm to the other in the air."""
