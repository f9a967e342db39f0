#include "stop.h"

#include "crossing_inline.h"
#include "elementary_inline.h"

typedef void (*kinematics)(const void *model, void *data);
typedef double (*geom_distance)(const void *model, void *data, int first, int second, double most,
                                double *segment);

/* Time until all joints are at rest. */
static double time_to_rest(const r47_stop *s, const double *v) {
  double most = 0.0;
  for (int j = 0; j < s->n; j++) most = largest(most, fabs(v[j]) / s->a[j]);
  return most;
}

/* How far joint j still goes, until it stands. */
static double way(const r47_stop *s, int together, double T, int j, double v) {
  return 0.5 * v * (together ? T : fabs(v) / s->a[j]);
}

/* Lets the bounds sink by what this way to rest may be off the one before it. */
static void sink(r47_stop *s, int together, const double *q, const double *v) {
  const int n = s->n;
  double *q0 = s->q + together * n, *v0 = s->v + together * n, *bound = s->bound;
  double off[R47_MAX_N];
  const double T = time_to_rest(s, v), T0 = time_to_rest(s, v0);
  bound += (size_t)together * s->pairs;
  for (int j = 0; j < n; j++) {
    const double end = q0[j] + way(s, together, T0, j, v0[j]), step = s->a[j] * s->dt;
    /* A tick further on the way before: its rest has been looked at, too. */
    const double slower = together ? (T0 > s->dt ? v0[j] * (1.0 - s->dt / T0) : 0.0)
                                   : v0[j] - clipped(v0[j], -step, step);
    const double start = q0[j] + 0.5 * s->dt * (v0[j] + slower);
    off[j] = largest(fabs(q[j] - start), fabs(q[j] + way(s, together, T, j, v[j]) - end));
    q0[j] = q[j], v0[j] = v[j];
  }
  for (int i = 0; i < s->pairs; i++) {
    const double *L = s->L + (size_t)i * n;
    double sum = 0.0;
    for (int j = 0; j < n; j++) sum += off[j] * L[j];
    bound[i] -= sum;
  }
}

static void place(const r47_stop *s, int together, double T, double share, const double *q,
                  const double *v) {
  for (int j = 0; j < s->n; j++) {
    const double own = together ? T : fabs(v[j]) / s->a[j], t = least(share * T, own);
    s->qpos[j] = own > 0.0 ? q[j] + v[j] * t * (1.0 - 0.5 * t / own) : q[j];
  }
  ((kinematics)s->kinematics)(s->model, s->data);
}

static double measured(const r47_stop *s, int i) {
  const int a = s->first[i], b = s->second[i];
  if (s->rbound[a] > 0.0 && s->rbound[b] > 0.0) {
    double square = 0.0;
    for (int k = 0; k < 3; k++) {
      const double apart = s->xpos[3 * a + k] - s->xpos[3 * b + k];
      square += apart * apart;
    }
    const double reach = s->rbound[a] + s->rbound[b] + s->far;
    if (square > reach * reach) return s->far;
  }
  if (s->capsule[i] >= 0 && may_cross(s->xpos, s->xmat, s->size, s->capsule[i], s->box[i]))
    return 0.0;
  double segment[6];
  return ((geom_distance)s->distance)(s->model, s->data, a, b, s->far, segment);
}

int r47_stop_is_clear(r47_stop *s, int together, const double *q, const double *v) {
  sink(s, together, q, v);
  double *bound = s->bound + (size_t)together * s->pairs;
  int count = 0;
  for (int i = 0; i < s->pairs; i++)
    if (bound[i] < s->least) {
      s->found[count] = s->far;
      s->todo[count++] = i;
    }
  if (!count) return 1;
  const double T = time_to_rest(s, v);
  for (int k = s->samples - 1; k >= (T > 0.0 ? 0 : s->samples - 1); k--) {
    place(s, together, T, s->share[k], q, v);
    for (int m = 0; m < count; m++) {
      s->found[m] = least(s->found[m], measured(s, (int)s->todo[m]));
      if (s->found[m] < s->least) return 0;
    }
  }
  for (int m = 0; m < count; m++) bound[s->todo[m]] = s->found[m];
  return 1;
}
