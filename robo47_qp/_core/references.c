#include "references.h"

#include "elementary_inline.h"

typedef void (*inverse_dynamics)(const void *model, void *data);
typedef void (*quaternion_of)(double *quaternion, const double *matrix);

void r47_reference_rows(const r47_references *r, int count, const double *q, const double *v,
                        const double *a, double *rows) {
  const int n = r->n;
  const size_t bytes = (size_t)n * sizeof(double);
  for (int k = 0; k < count; k++) {
    memcpy(r->qpos, q + k * n, bytes);
    memcpy(r->qvel, v + k * n, bytes);
    memcpy(r->qacc, a + k * n, bytes);
    ((inverse_dynamics)r->inverse)(r->model, r->data);
    memcpy(rows, r->qpos, bytes);
    memcpy(rows + n, r->qvel, bytes);
    memcpy(rows + 2 * n, r->qacc, bytes);
    memcpy(rows + 3 * n, r->qfrc_inverse, bytes);
    rows += 4 * n;
    for (int t = 0; t < r->tools; t++) {
      memcpy(rows, r->xpos + 3 * r->site[t], 3 * sizeof(double));
      ((quaternion_of)r->quaternion)(rows + 3, r->xmat + 9 * r->site[t]);
      rows += 7;
    }
  }
}
