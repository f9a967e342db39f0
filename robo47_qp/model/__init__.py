"""What the controller believes: the robot, its arm, what it holds and what stands around it."""
