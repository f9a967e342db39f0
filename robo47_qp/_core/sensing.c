#include "sensing.h"

#include "chain.h"
#include "elementary_inline.h"

static const double *next(const r47_draws *drawn) {
  return drawn->rows + (*drawn->at)++ * drawn->width;
}

void r47_delay_sample(r47_delay *d, const double *value, double *arrived) {
  const int k = d->k;
  const long long newest = (*d->newest + d->length - 1) % d->length;
  memcpy(d->past + newest * k, value, (size_t)k * sizeof(double));
  *d->newest = newest;
  /* What has arrived is never followed by something older. */
  if (d->drawn) *d->late = least(*next(d->drawn), *d->late + 1.0);
  const long long periods = (long long)*d->late;
  const double part = *d->late - (double)periods;
  const double *newer = d->past + (newest + periods) % d->length * k;
  if (part == 0.0) {
    memcpy(arrived, newer, (size_t)k * sizeof(double));
    return;
  }
  const double *older = d->past + (newest + periods + 1) % d->length * k;
  for (int i = 0; i < k; i++) arrived[i] = (1.0 - part) * newer[i] + part * older[i];
}

static void measure(r47_joint_sensor *s, const double *q, const double *v) {
  const int n = s->n;
  double now[2 * R47_MAX_N], arrived[2 * R47_MAX_N];
  memcpy(now, q, (size_t)n * sizeof(double));
  memcpy(now + n, v, (size_t)n * sizeof(double));
  r47_delay_sample(s->delay, now, arrived);
  const double *drawn = s->drawn ? next(s->drawn) : (const double *)0;
  for (int i = 0; i < n; i++) {
    const double seen = drawn ? arrived[i] + s->noise * drawn[i] : arrived[i];
    if (s->exact)
      s->v[i] = arrived[n + i];
    else
      s->v[i] += s->share * ((seen - s->q[i]) / s->period - s->v[i]);
    s->q[i] = seen;
  }
}

static void feel(r47_force_sensor *s) {
  const double *drawn = next(s->drawn);
  for (int i = 0; i < s->n; i++) {
    s->offset[i] = s->keep * s->offset[i] + s->fresh * drawn[i];
    s->error[i] = s->offset[i] + s->noise * drawn[s->n + i];
  }
}

void r47_sense(r47_senses *senses, const double *q, const double *v) {
  if (senses->joints) measure(senses->joints, q, v);
  if (senses->force) feel(senses->force);
}
