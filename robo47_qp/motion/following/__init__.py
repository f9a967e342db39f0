"""Joint paths along a path of the tool."""
