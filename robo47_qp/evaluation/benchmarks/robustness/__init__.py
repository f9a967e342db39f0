"""How much of each kind of wrongness a stack bears."""
