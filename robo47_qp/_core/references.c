#include "references.h"

#include "elementary_inline.h"

typedef void (*kinematics)(const void *model, void *data);
typedef void (*quaternion_of)(double *quaternion, const double *matrix);

void r47_reference_rows(const r47_references *r, int count, const double *q, const double *v,
                        const double *a, double *rows) {
  r47_dynamics *arm = r->arm;
  const int n = arm->n;
  const size_t bytes = (size_t)n * sizeof(double);
  for (int k = 0; k < count; k++) {
    memcpy(arm->qpos, q + k * n, bytes);
    memcpy(arm->qvel, v + k * n, bytes);
    memcpy(arm->qacc, a + k * n, bytes);
    r47_inverse(arm);
    memcpy(rows, arm->qpos, bytes);
    memcpy(rows + n, arm->qvel, bytes);
    memcpy(rows + 2 * n, arm->qacc, bytes);
    memcpy(rows + 3 * n, arm->qfrc_inverse, bytes);
    rows += 4 * n;
    for (int t = 0; t < r->tools; t++) {
      memcpy(rows, r->xpos + 3 * r->site[t], 3 * sizeof(double));
      ((quaternion_of)r->quaternion)(rows + 3, r->xmat + 9 * r->site[t]);
      rows += 7;
    }
  }
  /* An acceleration that is asked for next is that of the last row. */
  if (count > 0) r47_factor(arm);
}

void r47_tool_places(r47_dynamics *arm, const double *position, const double *quaternion, int count,
                     const double *q, double *positions, double *quaternions) {
  const size_t bytes = (size_t)arm->n * sizeof(double);
  for (int k = 0; k < count; k++) {
    memcpy(arm->qpos, q + k * arm->n, bytes);
    ((kinematics)arm->kinematics)(arm->model, arm->data);
    memcpy(positions + 3 * k, position, 3 * sizeof(double));
    memcpy(quaternions + 4 * k, quaternion, 4 * sizeof(double));
  }
}
