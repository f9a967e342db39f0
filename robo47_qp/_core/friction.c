#include "friction.h"

#include "elementary_inline.h"

typedef void (*solve_mass)(const void *model, void *data, double *x, const double *y, int rows);
typedef void (*times_mass)(const void *model, const void *data, double *product, const double *x);

/* Finds out by the disturbance how friction holds joints at rest. */
static void hold(r47_friction *c) {
  double product[R47_MAX_N];
  ((times_mass)c->mass)(c->model, c->data, product, c->held);
  for (int i = 0; i < c->n; i++) {
    const double f = c->f[i], z = c->z[i];
    const double turned = z + f / (f * f + c->R[i]) * (-product[i] - c->b[i] - f * z);
    c->z[i] = least(largest(turned, -1.0), 1.0);
  }
}

int r47_friction_change(r47_friction *c) {
  const int n = c->n;
  double torque[R47_MAX_N];
  const int starts = c->free && *c->moving < c->settling;
  const double per_displacement = starts ? c->per_start : c->per_displacement;
  int turned = 0, moved = 0, slow[R47_MAX_N];
  if (!c->started) {
    c->started = 1;
    memcpy(c->q, c->given, (size_t)n * sizeof(double));
    return 0;
  }
  for (int i = 0; i < n && !moved; i++) moved = c->given[i] != c->q[i];
  *c->rested += c->per_update;
  if (c->free && *c->rested > c->settling) hold(c);
  for (int i = 0; i < n; i++) {
    c->since[i] += c->per_update;
    const double step = c->given[i] - c->q[i];
    double z = step * per_displacement + c->z[i];
    z = largest(least(z, 1.0), -1.0);
    const double turn = z - c->z[i];
    c->gone[i] = turn != 0.0 || !moved ? 0.0 : c->gone[i] + fabs(step);
    slow[i] = turn != 0.0 || (fabs(step) < c->slow && c->gone[i] < c->loose);
    c->q[i] = c->given[i];
    c->z[i] = z;
    if (turn != 0.0) turned = 1;
    torque[i] = c->f[i] * (-turn * (starts ? 1.0 : least(fabs(step) / c->creeps, 1.0)));
  }
  for (int i = 0; i < n && moved; i++)
    if (slow[i]) c->since[i] = 0.0;
  if (moved) *c->rested = 0.0;
  *c->moving = moved ? *c->moving + c->per_update : 0.0;
  if (turned) ((solve_mass)c->solve)(c->model, c->data, c->change, torque, 1);
  return turned;
}

void r47_friction_learn(r47_friction *c) {
  double product[R47_MAX_N];
  if (++c->count % c->learning) return;
  ((times_mass)c->mass)(c->model, c->data, product, c->given);
  for (int i = 0; i < c->n; i++) {
    const double z = c->z[i];
    const double off = sqrt(c->P_bb[i]) + c->bias * fabs(c->bears[i] - c->borne[i]);
    c->borne[i] = c->bears[i];
    c->P_bb[i] = off * off + c->Q_bb[i];
    c->P_ff[i] += c->Q_ff[i];
    if (*c->rested > 0.0) continue;
    /* What is not to be learned from is infinitely noisy. */
    if (c->since[i] < c->settling) continue;
    const double c_b = c->P_bb[i] + z * c->P_bf[i], c_f = c->P_bf[i] + z * c->P_ff[i];
    const double S = c_b + z * c_f + c->R[i];
    const double k_b = c_b / S, k_f = c_f / S;
    const double error = -product[i] - c->b[i] - c->f[i] * z;
    c->b[i] += k_b * error;
    c->f[i] = least(largest(c->f[i] + k_f * error, 0.0), c->most[i]);
    c->P_bb[i] -= k_b * c_b;
    c->P_bf[i] -= k_b * c_f;
    c->P_ff[i] -= k_f * c_f;
  }
}
