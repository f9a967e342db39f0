"""IK solvers of other packages, behind the protocol of this one."""
