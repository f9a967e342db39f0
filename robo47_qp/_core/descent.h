/* Searches for a pose by steps that are small QPs inside the joint limits. */
#ifndef ROBO47_DESCENT_H
#define ROBO47_DESCENT_H

#include "chain.h"

enum { R47_MAX_TOOLS = 8, R47_MAX_STALL = 64 };

typedef struct {
  const r47_chain *chain;
  int tools;           /* tools that targets are for */
  const int *tool;     /* (tools,) their places among the chain's fixed frames */
  int turns;           /* 0 where the position alone has to be reached */
  int oriented;        /* 0 where no angle is measured */
  int logarithm;       /* nonzero: errors are logarithms of poses, and a posture is kept */
  double damping;      /* λ per squared error */
  double posture;      /* w per squared error */
  double floor;        /* least λ */
  const double *q_min; /* (n,) */
  const double *q_max; /* (n,) */
  double position;     /* tolerance [m] */
  double orientation;  /* [rad] */
  int max_iterations;
  int stall_steps;   /* 0: never given up early */
  double stall_fall; /* share of the squared error that must go in so many steps */
} r47_descent;

typedef struct {
  int iterations;
  int reached;
  double distance2; /* what is left, squared: of all tools together [m²] */
  double angle2;    /* [rad²] */
} r47_end;

/* Search from the point inside the limits that is closest to q, and leave the end there (n,).

   targets: quaternion wxyz and position of each tool (tools, 7)
   q_seed:  posture that a step is drawn to (n,) */
void r47_descend(const r47_descent *descent, const double *targets, const double *q_seed, double *q,
                 r47_end *end);

/* One step dq (n,) from q for an objective of the descent; 0 where there is none. */
int r47_step(const r47_descent *descent, const double *targets, const double *q_seed,
             const double *q, double *dq);

#endif
