/* Derivatives of a tool's pose from those of the joints; see motion/tool_motion.py. */
#ifndef ROBO47_TOOL_MOTION_H
#define ROBO47_TOOL_MOTION_H

/* The joints that move a tool, from the base on, and the tool's point. */
typedef struct {
  int n;                /* joints of the arm */
  int count;            /* of these move the tool */
  const int *joint;     /* (count,) which */
  const int *turns;     /* (count,) 0 where the joint slides */
  const double *axis;   /* (count, 3) direction where the joints are at `zero` */
  const double *moment; /* (count, 3) anchor x direction [m]; 0 where the joint slides */
  const double *zero;   /* (count,) */
  const double *point;  /* (3,) [m] */
} r47_screws;

/* Velocity, acceleration and jerk of the point, then those of the rotation: motion (rows, 18), in
   the world, for q, v, a and jerk j (rows, n). */
void r47_tool_motion(const r47_screws *screws, int rows, const double *q, const double *v,
                     const double *a, const double *j, double *motion);

#endif
