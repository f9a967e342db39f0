/* What is left from a pose to its target, and its derivative. */
#ifndef ROBO47_POSE_ERROR_H
#define ROBO47_POSE_ERROR_H

/* Frame (12,) of a pose given as a quaternion wxyz of any length and a position (7,). */
void r47_frame_of(const double *wxyz_xyz, double *T);

/* Displacement [m] and rotation vector [rad] from a frame to its target (6,), both with the axes of
   the world; the angle is π at most. */
void r47_pose_error(const double *T, const double *T_target, double *e);

/* Logarithm of the pose: the constant twist (6,) that covers the error e (6,) in unit time, linear
   part first. Per twist of the tool it decreases by [A B; 0 A], A and B (3, 3) each. */
void r47_pose_log(const double *e, double *twist, double *A, double *B);

#endif
