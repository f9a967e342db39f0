/* Whether a way to rest keeps all pairs of geoms apart; see SafeStop. */
#ifndef ROBO47_STOP_H
#define ROBO47_STOP_H

#include "chain.h"

typedef struct {
  int n, pairs, samples;
  void *model, *data, *kinematics, *distance; /* mj_kinematics, mj_geomDistance */
  double *qpos;                               /* (n,) of the data */
  const double *xpos, *xmat;                  /* of all geoms */
  const double *size, *rbound;
  const int *first, *second, *capsule, *box; /* (pairs,) geoms; the last two -1 for other shapes */
  const double *L;                           /* (pairs, n) */
  const double *a;                           /* (n,) decelerations */
  const double *share;                       /* (samples,) of the time to rest */
  double dt;
  double least; /* distance to be kept */
  double far;   /* distances are told apart up to this */
  /* Of both ways to stop: the state (2, n) that was asked for last, and how close the pairs
     (2, pairs) come from there, at least. */
  double *q, *v, *bound;
  long long *todo; /* (pairs,) memory */
  double *found;
} r47_stop;

/* Returns 1 where no pair comes too close on the way to rest from q, v (n,): each joint for itself
   as hard as it can, or `together` all in proportion. */
int r47_stop_is_clear(r47_stop *stop, int together, const double *q, const double *v);

#endif
