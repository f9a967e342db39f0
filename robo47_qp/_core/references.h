/* What a row of the recording holds of the reference: of the motion, its torques and tool poses. */
#ifndef ROBO47_REFERENCES_H
#define ROBO47_REFERENCES_H

#include "dynamics.h"

typedef struct {
  r47_dynamics *arm;
  void *quaternion; /* mju_mat2Quat */
  int tools;
  const int *site;           /* (tools,) their frames */
  const double *xpos, *xmat; /* (sites, 3) and (sites, 9) of the arm's data */
} r47_references;

/* Rows of q, v, a, tau (n each), then of each tool's position [m] and quaternion (w, x, y, z), from
   samples q, v, a (count, n): rows (count, 4 n + 7 tools). */
void r47_reference_rows(const r47_references *references, int count, const double *q,
                        const double *v, const double *a, double *rows);

/* Positions (count, 3) [m] and quaternions (count, 4) of a tool at q (count, n); where its position
   and its quaternion are in the data is given. */
void r47_tool_places(r47_dynamics *arm, const double *position, const double *quaternion, int count,
                     const double *q, double *positions, double *quaternions);

#endif
