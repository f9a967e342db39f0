#include "loop.h"

#include "elementary_inline.h"

typedef void (*half_step)(const void *model, void *data);

static void gather(const r47_world *w, int piece, int pieces, double *to) {
  for (int k = piece; k < piece + pieces; k++) {
    const size_t bytes = (size_t)w->size[k] * sizeof(double);
    memcpy(to, (const void *)(size_t)w->from[k], bytes);
    to += w->size[k];
  }
}

/* The torque closest to the command within the motors' limits; see SimulatedMotors. */
static void deliver(const r47_world *w, const double *tau) {
  for (int i = 0; i < w->n; i++) {
    const double now = w->ctrl[i];
    double new = least(largest(tau[i], now - w->rate[i]), now + w->rate[i]);
    new = least(new, w->most[i]);
    w->ctrl[i] = largest(new, -w->most[i]);
  }
}

/* Copies the joints' positions and velocities out of the data's pieces, and the torques into them.
 */
static void collect(const r47_world *w) {
  for (int k = 0, i = 0; k < w->pieces; i += w->length[k++]) {
    const size_t bytes = (size_t)w->length[k] * sizeof(double);
    memcpy(w->q + i, (const void *)(size_t)w->q_at[k], bytes);
    memcpy(w->v + i, (const void *)(size_t)w->v_at[k], bytes);
  }
}

static void spread(const r47_world *w) {
  for (int k = 0, i = 0; k < w->pieces; i += w->length[k++])
    memcpy((void *)(size_t)w->ctrl_at[k], w->ctrl + i, (size_t)w->length[k] * sizeof(double));
}

static int finite(const double *x, int n) {
  double square = 0.0;
  for (int i = 0; i < n; i++) square += x[i] * x[i];
  return square < INFINITY;
}

static void grip(const r47_world *w) {
  for (int k = 0; k < w->grippers; k++) {
    double *servo = w->all_ctrl + w->servo[k];
    const double step = *servo < w->unloaded[k] ? w->unloading[k] : w->speed[k];
    if (*servo != w->width[k]) *servo = least(largest(w->width[k], *servo - step), *servo + step);
  }
}

static int touching(const r47_world *w) {
  for (int k = 0; k < w->touches; k++)
    if (w->touch[k] != 0.0) return 1;
  return 0;
}

/* See r47_run. */
static int run(r47_control *control, r47_world *w, int periods, const double *q_ref,
               const double *v_ref, const double *a_ref, double *rows, int width, int command,
               long long *filled) {
  const int n = w->n;
  double tau[R47_MAX_N], arrived[R47_MAX_N];
  const double *q = w->q, *v = w->v, *felt = tau;
  if (w->senses && w->senses->joints) q = w->senses->joints->q, v = w->senses->joints->v;
  if (w->senses && w->senses->torque) felt = arrived;
  collect(w);
  for (int k = 0; k < periods; k++) {
    double *row = rows + (size_t)k * (size_t)width;
    gather(w, 0, w->firsts, row + w->first);
    r47_next_torque(control, q_ref + k * n, v_ref + k * n, a_ref + k * n, q, v, tau);
    memcpy(row + command, control->commanded, (size_t)n * sizeof(double));
    if (!finite(tau, n)) return -(k + 1);
    if (felt == arrived) r47_delay_sample(w->senses->torque, tau, arrived);
    deliver(w, felt);
    spread(w);
    grip(w);
    ((half_step)w->step2)(w->model, w->data);
    ((half_step)w->step1)(w->model, w->data);
    collect(w);
    if (w->senses) r47_sense(w->senses, w->q, w->v);
    if (touching(w)) return -(k + 1);
    memset(w->sums, 0, (size_t)w->summed * sizeof(double));
    for (int t = 0; t < w->tools; t++) {
      const double *whole = (const double *)(size_t)w->whole[t];
      const double *within = (const double *)(size_t)w->within[t];
      for (int i = 0; i < 3; i++) w->force[3 * t + i] = within[i] - whole[i];
    }
    gather(w, w->firsts, w->lates, row + w->late);
    /* Who reads the rows of a run that goes on finds the row complete. */
    __atomic_store_n(filled, *filled + 1, __ATOMIC_RELEASE);
  }
  return periods;
}

static double no_time(void) {
  return 0.0;
}

int r47_run(r47_control *control, r47_world *w, int periods, const double *q_ref,
            const double *v_ref, const double *a_ref, double *rows, int width, int command,
            long long *filled) {
  void *clock = *w->clock;
  *w->clock = (void *)no_time;
  const int done = run(control, w, periods, q_ref, v_ref, a_ref, rows, width, command, filled);
  /* A run on another thread may have begun or ended meanwhile. */
  if (clock != (void *)no_time) *w->clock = clock;
  r47_factor(control->arm);
  return done;
}
