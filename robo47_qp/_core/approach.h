/* The closest approach of pairs of geoms along a motion; see ClosestApproach. */
#ifndef ROBO47_APPROACH_H
#define ROBO47_APPROACH_H

typedef struct {
  void *model, *data;
  void *kinematics, *distance; /* mj_kinematics, mj_geomDistance */
  double *qpos;
  int joints;
  const int *address;        /* (joints,) places in qpos */
  const double *xpos, *xmat; /* (geoms, 3) and (geoms, 9) of the data */
  const double *size;        /* (geoms, 3) of the model */
  int pairs;
  const int *first, *second; /* (pairs,) geoms */
  const int *capsule, *box;  /* (pairs,) of a pair of these two, else -1 */
  double far;                /* largest cut-off [m]; what is further is at infinity */
} r47_approach;

/* Distances (pairs,) at q (joints,); `doubtful` (pairs,) is 1 where MuJoCo's may be wrong, as the
   axis of a capsule may cross a box. */
void r47_approach_at(const r47_approach *approach, const double *q, double *distance,
                     unsigned char *doubtful);

/* Follow a pair through q (rows, joints), skipping rows in which it cannot be closer than the
   closest found so far by more than the resolution.

   `closed` (rows,) is by how much it can have come closer since the first row. distance (2,) is
   that in the present row, and the smallest so far; row (2,) is the present one, and that of the
   smallest. Returns 1 where the distance is doubtful: the caller measures it, and comes again. */
int r47_approach_along(const r47_approach *approach, int pair, int rows, const double *q,
                       const double *closed, double resolution, double *distance, int *row);

#endif
