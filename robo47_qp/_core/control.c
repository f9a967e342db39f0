#include "control.h"

#include "elementary_inline.h"

/* 3 x^2 - 2 x^3 of what is left. */
static double rest(int left, int fade) {
  const double x = (double)left / fade;
  return x * x * (3.0 - 2.0 * x);
}

/* Leaves of the compensation what tools that hold one body may do; see ClosedChain. */
static void keep_together(r47_control *c) {
  const int n = c->n;
  double beyond[R47_MAX_N];
  for (int i = 0; i < n; i++) beyond[i] = c->compensation[i] - c->base[i];
  for (int i = 0; i < n; i++) {
    double sum = 0.0;
    for (int k = 0; k < n; k++) sum += c->shares[i * n + k] * beyond[k];
    c->compensation[i] = c->base[i] + sum;
  }
}

/* Takes what changes of the delay out of the measured positions. */
static void remove_jitter(r47_control *c, double *measured) {
  const int n = c->n;
  const double *q = c->estimate, *v = q + n, *d = v + n, *a = c->expected;
  const double *to_q = c->next, *to_v = c->next + 4;
  double speed[R47_MAX_N], along = 0.0, square = 0.0;
  for (int i = 0; i < n; i++) {
    const double expected = to_q[0] * q[i] + to_q[1] * v[i] + to_q[2] * d[i] + to_q[3] * a[i];
    speed[i] = to_v[0] * q[i] + to_v[1] * v[i] + to_v[2] * d[i] + to_v[3] * a[i];
    along += speed[i] * (measured[i] - expected);
    square += speed[i] * speed[i];
  }
  const double shift = along / (square + c->jitter_floor);
  *c->jitter += c->jitter_share * (shift - *c->jitter);
  for (int i = 0; i < n; i++) measured[i] -= (shift - *c->jitter) * speed[i];
}

/* State and reference of the instant at which the next command is felt. */
static void look_ahead(const r47_control *c, double *q_ref, double *v_ref, const double *a_ref,
                       double *q, double *v) {
  const int n = c->n, k = c->delay;
  const double t = c->ahead;
  for (int i = 0; i < n; i++) {
    double to[2] = {0.0, 0.0};
    for (int r = 0; r < 2; r++) {
      const double *by = c->predict + r * (3 + k);
      for (int j = 0; j < 3; j++) to[r] += by[j] * c->estimate[j * n + i];
      for (int j = 0; j < k; j++) to[r] += by[3 + j] * c->pending[j * n + i];
    }
    q[i] = to[0], v[i] = to[1];
    /* The velocity is the mean of the period that has ended; see ActiveController.sampled. */
    q_ref[i] += t * (v_ref[i] + 0.5 * (t + c->period) * a_ref[i]);
    v_ref[i] += t * a_ref[i];
  }
}

static void estimate(r47_control *c, const double *q_measured, double *a) {
  const int n = c->n;
  double *q = c->estimate, *v = q + n, *d = v + n;
  double square = 0.0, measured[R47_MAX_N];
  memcpy(measured, q_measured, (size_t)n * sizeof(double));
  if (c->jitter_floor > 0.0) remove_jitter(c, measured);
  for (int i = 0; i < n; i++) {
    const double known[5] = {q[i], v[i], d[i], c->expected[i], measured[i]};
    double next[3] = {0.0, 0.0, 0.0};
    for (int r = 0; r < 3; r++)
      for (int k = 0; k < 5; k++) next[r] += c->filter[(5 * r + k) * n + i] * known[k];
    q[i] = next[0], v[i] = next[1], d[i] = next[2];
    square += d[i] * d[i];
  }
  if (c->on || c->closed) {
    c->follows = c->on && !c->observer_left && square < c->least;
    double share = 0.0;
    if (c->observer_left) share = rest(--c->observer_left, c->observer_fade);
    for (int i = 0; i < n; i++) {
      c->compensation[i] = c->follows ? d[i] : clipped(d[i], -c->bound[i], c->bound[i]);
      if (share > 0.0) c->compensation[i] += share * c->offset[i];
    }
    if (c->closed) keep_together(c);
  }
  for (int i = 0; i < n; i++) a[i] -= c->compensation[i];
}

static void law(const r47_control *c, const double *q_ref, const double *v_ref, const double *a_ref,
                const double *q, const double *v, double *tau) {
  const int n = c->n;
  r47_dynamics *arm = c->arm;
  if (c->law == R47_CARTESIAN_IMPEDANCE) {
    r47_impedance_torque(c->impedance, q_ref, v_ref, a_ref, q, v, tau);
    return;
  }
  for (int i = 0; i < n; i++) {
    arm->qpos[i] = q[i], arm->qvel[i] = v[i], arm->qacc[i] = a_ref[i];
    if (c->law == R47_COMPUTED_TORQUE)
      arm->qacc[i] = (q_ref[i] - q[i]) * c->stiffness + (v_ref[i] - v[i]) * c->damping + a_ref[i];
  }
  r47_inverse(arm);
  memcpy(tau, arm->qfrc_inverse, (size_t)n * sizeof(double));
  if (!c->K) return;
  for (int i = 0; i < n; i++) {
    tau[i] += c->K[i] * (q_ref[i] - q[i]);
    tau[i] += c->D[i] * (v_ref[i] - v[i]);
  }
}

/* Adds the joint stops where a limit is near, and keeps the limits of the motors. */
static void limit(r47_control *c, const double *q_ref, const double *q, double *tau) {
  const int n = c->n;
  int free = 1;
  for (int i = 0; i < n; i++) {
    const double change = tau[i] - c->last[i];
    free = free && change >= -c->rate[i] && change <= c->rate[i] && tau[i] >= -c->most[i] &&
           tau[i] <= c->most[i] && q[i] >= c->low[i] && q[i] <= c->high[i];
  }
  for (int i = 0; i < n; i++) {
    if (!free) {
      const double low = largest(least(c->low[i], q_ref[i]), c->q_min[i]);
      const double high = least(largest(c->high[i], q_ref[i]), c->q_max[i]);
      const double below = largest(low - q[i], 0.0), above = largest(q[i] - high, 0.0);
      tau[i] += c->stop[i] * (below * below - above * above) / c->square[i];
    }
    c->commanded[i] = tau[i];
    if (!free) {
      tau[i] = clipped(tau[i], c->last[i] - c->rate[i], c->last[i] + c->rate[i]);
      tau[i] = clipped(tau[i], -c->most[i], c->most[i]);
      /* After no number nothing is within the rate. */
      if (c->last[i] != c->last[i]) tau[i] = c->last[i];
    }
    c->last[i] = tau[i];
  }
}

/* Takes in the torque: the acceleration that the belief expects of it. */
static void expect(r47_control *c, const double *tau) {
  const int n = c->n;
  double excess[R47_MAX_N];
  int same = 1;
  for (int i = 0; i < n; i++) {
    excess[i] = tau[i] - c->arm->qfrc_inverse[i];
    same = same && tau[i] == c->arm->qfrc_inverse[i];
  }
  const size_t row = (size_t)n * sizeof(double);
  double *a = c->expected;
  if (c->delay) {
    /* What the next measurement shows was commanded a while ago. */
    memcpy(c->expected, c->pending, row);
    for (int k = 1; k < c->delay; k++) memcpy(c->pending + (k - 1) * n, c->pending + k * n, row);
    a = c->pending + (c->delay - 1) * n;
  }
  if (same) {
    memcpy(a, c->arm->qacc, row);
  } else {
    r47_solve(c->arm, a, excess, 1);
    for (int i = 0; i < n; i++) a[i] += c->arm->qacc[i];
  }
  if (!c->turning) return;
  for (int i = 0; i < n; i++) {
    c->estimate[2 * n + i] += c->turned[i];
    if (!c->on || c->follows) c->compensation[i] += c->turned[i];
    if (c->closed) c->base[i] += c->turned[i];
  }
}

/* Changes the disturbance where joints reverse, and learns from it. */
static void update_friction(r47_control *c, const double *q_ref) {
  const size_t bytes = (size_t)c->n * sizeof(double);
  r47_friction *friction = c->friction;
  friction->model = c->arm->model;
  friction->data = c->arm->data;
  r47_factor(c->arm);
  memcpy(friction->given, q_ref, bytes);
  friction->free = c->free;
  memcpy(friction->held, c->estimate + 2 * c->n, bytes);
  c->turning = r47_friction_change(friction);
  /* All at once, a torque that turns within a few periods would be a step. */
  if (c->turning)
    for (int i = 0; i < c->n; i++) c->turned[i] = friction->change[i] / c->periods;
  c->until = c->periods;
  if (!c->learns) return;
  memcpy(friction->given, c->estimate + 2 * c->n, bytes);
  memcpy(friction->bears, c->arm->qfrc_bias, bytes);
  r47_friction_learn(friction);
}

void r47_next_torque(r47_control *c, const double *q_ref, const double *v_ref, const double *a_ref,
                     const double *q, const double *v, double *tau) {
  const int n = c->n;
  const size_t row = (size_t)n * sizeof(double);
  double a[R47_MAX_N], v_at[R47_MAX_N], q_there[R47_MAX_N], v_there[R47_MAX_N];
  memcpy(a, a_ref, row);
  if (c->observed) {
    estimate(c, q, a);
    q = c->estimate;
    v = q + n;
    memcpy(c->tracked, q_ref, row);
    q_ref = c->tracked;
    if (c->delay) {
      memcpy(v_at, v_ref, row);
      look_ahead(c, c->tracked, v_at, a_ref, q_there, v_there);
      v_ref = v_at, q = q_there, v = v_there;
    }
  }
  law(c, q_ref, v_ref, a, q, v, tau);
  if (c->left) {
    const double share = rest(c->left--, c->fade);
    for (int i = 0; i < n; i++) tau[i] += share * c->bump[i];
    if (!c->left) c->fade = 0;
  }
  limit(c, q_ref, q, tau);
  if (!c->observed) return;
  expect(c, tau);
  if (c->until && !--c->until) update_friction(c, q_ref);
}

void r47_torques(r47_control *c, int periods, const double *q_ref, const double *v_ref,
                 const double *a_ref, const double *q, const double *v, double *tau) {
  const int n = c->n;
  for (int k = 0; k < periods * n; k += n)
    r47_next_torque(c, q_ref + k, v_ref + k, a_ref + k, q + k, v + k, tau + k);
  r47_factor(c->arm);
}
