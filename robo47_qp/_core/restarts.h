/* Descents from one start after another until a target is reached. */
#ifndef ROBO47_RESTARTS_H
#define ROBO47_RESTARTS_H

#include "descent.h"

/* Configurations that are found by their tool poses. */
typedef struct {
  int count;
  int features;             /* 12: position and weighted rotation matrix; 3: position */
  double turn;              /* weight of an entry of the rotation matrix */
  const double *q;          /* (count, n) */
  const float *feature;     /* (features, count) */
  const float *half_square; /* half the squared length of each feature (count,) */
} r47_library;

typedef struct {
  const r47_descent *descent;
  const r47_descent *thorough; /* continues the closest ends */
  const r47_library *library;
  int starts;       /* at most so many */
  int near;         /* of them chosen for nearness, before the others in their order */
  int seed_first;   /* else the nearer of the seed and the library's nearest first */
  int looks;        /* how often the closest ends are continued */
  const int *look;  /* (looks,) after so many starts */
  double close;     /* largest error of an end that is continued [m + rad] */
  double same;      /* ends whose joints differ by less are one [rad or m] */
  int ends;         /* ends that are continued at each look, 8 at most */
  int stills;       /* joints that do not move the tool, and stay at the seed */
  const int *still; /* (stills,) */
} r47_restarts;

/* Numbers of an answer, one after the other. */
enum {
  R47_FOUND,      /* 1 where the target is reached */
  R47_ITERATIONS, /* over all descents */
  R47_DESCENTS,   /* from starts, and those that continue ends */
  R47_ANSWER      /* how many numbers */
};

/* Half the squared distance of each configuration's feature to that of a frame, but for one
   constant: `distance` (count,). */
void r47_library_distances(const r47_library *library, const double *T, float *distance);

/* Solve for poses of one tool, one after another.

   targets: quaternion wxyz and position (count, 7)
   q_seeds: where each search starts (count, n)
   scratch: memory (library->count,)
   q:       answers (count, n)
   answers: (count, R47_ANSWER) */
void r47_solve_many(const r47_restarts *restarts, int count, const double *targets,
                    const double *q_seeds, float *scratch, double *q, double *answers);

#endif
