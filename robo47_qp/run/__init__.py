"""One run: the steps of a program, the control loop, the recording."""
