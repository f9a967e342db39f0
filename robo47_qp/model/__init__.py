"""The controller's model: robot, arm, payload and obstacles."""
