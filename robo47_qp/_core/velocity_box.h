/* Joint velocities that leave room to brake before the joint limits; see JointBounds. */
#ifndef ROBO47_VELOCITY_BOX_H
#define ROBO47_VELOCITY_BOX_H

/* Writes the lowest and highest velocities (n,) at the next tick, from q, v (n,). Of each joint
   `limits` (n, 5) holds both ends of its range, its speed, by how much that may change in a tick
   dt, and the room from which on a limit does not matter.

   Returns 1 where a joint exceeds a limit by more than `rounding`: then there is no such box. */
int r47_velocity_box(int n, const double *limits, double dt, double rounding, const double *q,
                     const double *v, double *low, double *high);

#endif
