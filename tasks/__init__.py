"""Jobs for the robot, one module each."""
