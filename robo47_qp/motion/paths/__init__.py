"""Curves of the tool: lines, arcs, splines, and how they are joined."""
