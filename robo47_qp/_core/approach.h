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
  const double *rbound;      /* (geoms,) radii of bounding spheres [m]; 0 for planes */
  const double *aabb;        /* (geoms, 6) bounding boxes: centre and half lengths [m] */
  int pairs;
  const int *first, *second; /* (pairs,) geoms */
  const int *capsule, *box;  /* (pairs,) of a pair of these two, else -1 */
  double far;                /* largest cut-off [m]; what is further is at infinity */
  const double *reach;       /* (pairs, joints) by how much a joint brings a pair closer, at most */
} r47_approach;

/* The search for the closest approach along a motion. */
typedef struct {
  int rows;
  const double *q;         /* (rows, joints) */
  const double *travelled; /* (rows, joints) how far each joint has come since the first row */
  const double *start;     /* (pairs,) distances in the first row [m] */
  const int *order;        /* (pairs,) in which pairs are followed */
  double resolution;       /* how much closer a pair may be than is found [m] */
  double best;             /* the smallest distance so far [m] */
  int best_row, best_pair;
  int next;        /* of `order`, the pair that is followed */
  int row;         /* the row that it has come to; less than 0 before the first */
  double distance; /* its distance there [m] */
  int asked;       /* whether the caller was asked for that */
} r47_path;

/* Distances (pairs,) at q (joints,), `seen` at most; `doubtful` (pairs,) is 1 where MuJoCo's may be
   wrong, as the axis of a capsule may cross a box. */
void r47_approach_at(const r47_approach *approach, const double *q, double seen, double *distance,
                     unsigned char *doubtful);

/* Follow all pairs through the motion, skipping rows in which one cannot be closer than the closest
   found so far by more than the resolution.

   Returns 1 where a distance is doubtful: the caller measures it where the robot is placed, writes
   it into the path, and comes again. */
int r47_approach_along(const r47_approach *approach, r47_path *path);

#endif
