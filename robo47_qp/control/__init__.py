"""Controllers: joint torques from a reference and a state."""
