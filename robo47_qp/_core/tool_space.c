#include "tool_space.h"

#include "elementary_inline.h"
#include "linear_inline.h"

typedef void (*kinematics)(const void *model, void *data);
typedef void (*site_jacobian)(const void *model, const void *data, double *linear, double *angular,
                              int site);
typedef void (*body_jacobian)(const void *model, const void *data, double *linear, double *angular,
                              const double *point, int body);

static void place_reference(r47_tool_space *s, const double *q_ref) {
  int same = s->placed;
  for (int i = 0; i < s->arm->n; i++) {
    same = same && s->q[i] == q_ref[i];
    s->q[i] = q_ref[i];
  }
  if (!same) ((kinematics)s->arm->kinematics)(s->arm->model, s->data);
  s->placed = 1;
}

/* A = R^T A for the n vectors that are its columns (3, n). */
static void turn_back(const double *R, int n, double *A) {
  for (int j = 0; j < n; j++) {
    const double a = A[j], b = A[n + j], c = A[2 * n + j];
    for (int i = 0; i < 3; i++) A[i * n + j] = R[i] * a + R[3 + i] * b + R[6 + i] * c;
  }
}

static void errors(r47_tool_space *s) {
  double apart[3];
  for (int i = 0; i < 3; i++) s->error[i] = apart[i] = s->position_ref[i] - s->position[i];
  if (s->in_tool)
    for (int i = 0; i < 3; i++)
      s->error[i] = s->rotation_ref[i] * apart[0] + s->rotation_ref[3 + i] * apart[1] +
                    s->rotation_ref[6 + i] * apart[2];
  const double *p = s->quaternion, *r = s->quaternion_ref;
  double cross[3], *out = s->rotation;
  cross3(r + 1, p + 1, cross);
  /* Reference times conjugate; in the tool's axes order and cross product are reversed. */
  const double sign = s->in_tool ? -1.0 : 1.0;
  out[0] = r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3] * p[3];
  for (int i = 0; i < 3; i++) out[1 + i] = r[1 + i] * p[0] - r[0] * p[1 + i] - sign * cross[i];
}

/* The inverse of A (6, 6), of which only the lower triangle is read, by its Cholesky factors;
   returns 0 where it is not positive. */
static int invert(const double *A, double *inverse) {
  double L[36];
  for (int i = 0; i < 6; i++)
    for (int j = 0; j <= i; j++) {
      double sum = A[6 * i + j];
      for (int k = 0; k < j; k++) sum -= L[6 * i + k] * L[6 * j + k];
      if (i > j)
        L[6 * i + j] = sum / L[6 * j + j];
      else if (sum > 0.0)
        L[6 * i + i] = sqrt(sum);
      else
        return 0;
    }
  for (int c = 0; c < 6; c++) {
    double x[6];
    for (int i = 0; i < 6; i++) {
      double sum = i == c;
      for (int k = c; k < i; k++) sum -= L[6 * i + k] * x[k];
      x[i] = i < c ? 0.0 : sum / L[6 * i + i];
    }
    for (int i = 5; i >= c; i--) {
      for (int k = i + 1; k < 6; k++) x[i] -= L[6 * k + i] * x[k];
      x[i] /= L[6 * i + i];
      inverse[6 * i + c] = inverse[6 * c + i] = x[i];
    }
  }
  return 1;
}

/* By how much the largest inertia is beyond what counts as close to singular; 1 at its bound. */
static double heaviest(const r47_tool_space *s) {
  double most = 0.0;
  for (int i = 0; i < 6; i++) most = largest(most, s->inertia[7 * i] * s->lightest[i]);
  return most;
}

void r47_tool_place(r47_tool_space *s, const double *q_ref, const double *q) {
  r47_dynamics *arm = s->arm;
  const int n = arm->n;
  double A[36];
  place_reference(s, q_ref);
  memcpy(arm->qpos, q, (size_t)n * sizeof(double));
  r47_place(arm);
  errors(s);
  ((site_jacobian)s->jacobian)(arm->model, arm->data, s->J, s->J + 3 * n, s->site);
  if (s->in_tool) {
    turn_back(s->rotation_ref, n, s->J);
    turn_back(s->rotation_ref, n, s->J + 3 * n);
  }
  r47_solve(arm, s->J_over_M, s->J, 6);
  for (int i = 0; i < 6; i++)
    for (int j = 0; j <= i; j++) {
      A[6 * i + j] = 0.0;
      for (int k = 0; k < n; k++) A[6 * i + j] += s->J_over_M[i * n + k] * s->J[j * n + k];
    }
  const double most = invert(A, s->inertia) ? heaviest(s) : INFINITY;
  if (!(most > 1.0)) return;
  const double near = 1.0 - 1.0 / most;
  for (int i = 0; i < 6; i++) A[7 * i] += near * near * s->lightest[i];
  invert(A, s->inertia);
}

void r47_tool_twist(const r47_tool_space *s, const double *x, double *product) {
  const int n = s->arm->n;
  for (int i = 0; i < 6; i++) {
    product[i] = 0.0;
    for (int k = 0; k < n; k++) product[i] += s->J[i * n + k] * x[k];
  }
}

void r47_tool_inertia_times(const r47_tool_space *s, const double *x, double *product) {
  for (int i = 0; i < 6; i++) {
    product[i] = 0.0;
    for (int k = 0; k < 6; k++) product[i] += s->inertia[6 * i + k] * x[k];
  }
}

void r47_tool_null(const r47_tool_space *s, const double *x, const double *twist, double *part) {
  const int n = s->arm->n;
  double force[6];
  r47_tool_inertia_times(s, twist, force);
  for (int k = 0; k < n; k++) {
    double moved = 0.0;
    for (int i = 0; i < 6; i++) moved += force[i] * s->J_over_M[i * n + k];
    part[k] = x[k] - moved;
  }
}

void r47_tool_rate_times(const r47_tool_space *s, const double *x, double *product) {
  const r47_dynamics *arm = s->arm;
  const int n = arm->n;
  double rate[6 * R47_MAX_N];
  ((body_jacobian)s->jacobian_rate)(arm->model, arm->data, rate, rate + 3 * n, s->position,
                                    s->body);
  for (int i = 0; i < 6; i++) {
    product[i] = 0.0;
    for (int k = 0; k < n; k++) product[i] += rate[i * n + k] * x[k];
  }
  if (!s->in_tool) return;
  turn_back(s->rotation_ref, 1, product);
  turn_back(s->rotation_ref, 1, product + 3);
}
