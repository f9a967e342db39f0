/* How far apart pairs of geoms are, and how fast they may approach; see ClearanceBounds. */
#ifndef ROBO47_CLEARANCE_H
#define ROBO47_CLEARANCE_H

#include "chain.h"

typedef struct {
  int n, pairs;
  int most;                                  /* pairs to be measured in a tick, and rows */
  void *model, *data, *distance;             /* mj_geomDistance, of data that is up to date */
  const double *xpos, *xmat, *size;          /* of all geoms */
  const int *first, *second, *capsule, *box; /* (pairs,) geoms; the last two -1 for other shapes */
  const double *cdof, *com;                  /* (n, 6) twist of each joint about com[root] (3,) */
  const int *root;                           /* (n,) */
  const double *sign, *L;    /* (pairs, n) which joints close a pair, and its bounds */
  const double *least_brake; /* (pairs,) */
  const double *a;           /* (n,) accelerations that are counted on */
  double dt, d_min;
  /* Constants of ClearanceBounds. */
  double far, ahead, touch, near, least, parting, regain, unsure, trusted;
  /* What is known of each pair (pairs,), and its row A (pairs, n). */
  double *bound, *A, *stop, *brake;
  unsigned char *unseen, *looked;
  double *q; /* (n,) where that holds */
  double travel;
  /* Pairs of this tick, the most urgent first, room below which each matters, and the first of
     them measured: distance, nearest points (6,), whether the caller has to measure again. */
  int urgent, picked;
  long long *pair; /* (pairs,) */
  double *within, *apart, *segment;
  unsigned char *doubtful;
  double *key; /* (pairs,) memory */
  long long *order, *other;
  double measured; /* the smallest distance of this tick */
  /* The rows of this tick: A (most, n), upper, room, and their pairs. */
  double *row_A, *row_upper, *row_room;
  long long *row_pair;
} r47_clearance;

/* Look at every pair at q (n,); returns how many are doubtful. */
int r47_clearance_reset(r47_clearance *clearance, const double *q);

/* Let bounds sink on the way to q, v (n,), and measure the pairs that may matter; likewise. */
int r47_clearance_look(r47_clearance *clearance, const double *q, const double *v);

/* Take in what was measured. */
void r47_clearance_take(r47_clearance *clearance);

/* The rows of this tick; returns how many. */
int r47_clearance_rows(r47_clearance *clearance, const double *v);

#endif
