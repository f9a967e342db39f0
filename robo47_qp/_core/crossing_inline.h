/* A capsule whose axis may cross a box: what mj_geomDistance tells of such a pair is not sure. */
#ifndef ROBO47_CROSSING_INLINE_H
#define ROBO47_CROSSING_INLINE_H

#include "elementary_inline.h"

/* Whether a capsule's axis reaches into the box's slabs along all three of its normals; places,
   axes and sizes are those of all geoms, 3, 9 and 3 each. Beyond rounding: the caller decides by
   the same inequality without it. */
static inline int may_cross(const double *xpos, const double *xmat, const double *size, int capsule,
                            int box) {
  const double *c = xpos + 3 * box, *R = xmat + 9 * box;
  const double *p = xpos + 3 * capsule, *U = xmat + 9 * capsule;
  const double half = size[3 * capsule + 1];
  for (int i = 0; i < 3; i++) {
    double middle = 0.0, axis = 0.0;
    for (int k = 0; k < 3; k++) {
      middle += (p[k] - c[k]) * R[3 * k + i];
      axis += U[3 * k + 2] * R[3 * k + i];
    }
    if (fabs(middle) >= size[3 * box + i] + half * fabs(axis) + 1e-9) return 0;
  }
  return 1;
}

#endif
