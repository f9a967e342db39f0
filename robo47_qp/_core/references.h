/* What a row of the recording holds of the reference: of the motion, its torques and tool poses. */
#ifndef ROBO47_REFERENCES_H
#define ROBO47_REFERENCES_H

/* An arm, by MuJoCo's functions and the arrays of its state. */
typedef struct {
  int n;
  void *model, *data;
  void *inverse;    /* mj_inverse */
  void *quaternion; /* mju_mat2Quat */
  double *qpos, *qvel, *qacc;
  const double *qfrc_inverse;
  int tools;
  const int *site;           /* (tools,) their frames */
  const double *xpos, *xmat; /* (sites, 3) and (sites, 9) of the state */
} r47_references;

/* Rows of q, v, a, tau (n each), then of each tool's position [m] and quaternion (w, x, y, z), from
   samples q, v, a (count, n): rows (count, 4 n + 7 tools). */
void r47_reference_rows(const r47_references *references, int count, const double *q,
                        const double *v, const double *a, double *rows);

#endif
