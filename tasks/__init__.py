"""Tasks for the robot, one folder per family and their shared parts."""
