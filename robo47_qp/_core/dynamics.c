#include "dynamics.h"

typedef void (*stage)(const void *model, void *data);
typedef void (*times_mass)(const void *model, const void *data, double *product, const double *x);
typedef void (*solve_mass)(const void *model, void *data, double *x, const double *y, int rows);
typedef void (*newton_euler)(const void *model, void *data, int accelerations, double *torque);

void r47_place(r47_dynamics *d) {
  ((stage)d->kinematics)(d->model, d->data);
  ((stage)d->centres)(d->model, d->data);
  ((stage)d->mass)(d->model, d->data);
  d->factored = 0;
}

void r47_inverse_here(r47_dynamics *d) {
  ((stage)d->velocities)(d->model, d->data);
  ((stage)d->passive)(d->model, d->data);
  ((newton_euler)d->bias)(d->model, d->data, 0, d->qfrc_bias);
  /* In place: arms of any number of joints come here. */
  ((times_mass)d->times)(d->model, d->data, d->qfrc_inverse, d->qacc);
  for (int i = 0; i < d->n; i++)
    d->qfrc_inverse[i] = d->qfrc_inverse[i] - d->qfrc_passive[i] + d->qfrc_bias[i];
}

void r47_inverse(r47_dynamics *d) {
  r47_place(d);
  r47_inverse_here(d);
}

void r47_factor(r47_dynamics *d) {
  if (d->factored) return;
  ((stage)d->factor)(d->model, d->data);
  d->factored = 1;
}

void r47_solve(r47_dynamics *d, double *x, const double *y, int rows) {
  r47_factor(d);
  ((solve_mass)d->solve)(d->model, d->data, x, y, rows);
}
