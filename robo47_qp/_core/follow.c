#include "follow.h"

#include "box_qp.h"
#include "elementary_inline.h"
#include "linear_inline.h"

typedef void (*update)(const void *model, void *data);
typedef void (*quaternion_difference)(double *out, const double *a, const double *b);
typedef void (*rotation)(double *out, const double *vector, const double *quaternion);

/* Rotation vector from quaternion b to a, with the axes of the world. */
static void turned(const r47_follow *f, const double *a, const double *b, double *out) {
  double own[3];
  ((quaternion_difference)f->difference)(own, a, b);
  ((rotation)f->rotated)(out, own, b);
}

/* Six rows of the Jacobian of tool k, in metres and radians. */
static void jacobian(const r47_follow *f, int k, double *J) {
  const double *p = f->site_xpos + 3 * f->site[k];
  const int n = f->n;
  for (int j = 0; j < n; j++) {
    double column[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    if (f->moves[k * n + j]) {
      const double *twist = f->cdof + 6 * j, *centre = f->com + 3 * f->root[j];
      const double from[3] = {p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]};
      cross3(twist, from, column);
      for (int i = 0; i < 3; i++) column[i] += twist[3 + i], column[3 + i] = twist[i];
    }
    for (int i = 0; i < 6; i++) J[i * n + j] = column[i];
  }
}

static void shorten(double *displacement, double longest) {
  double most = 0.0;
  for (int i = 0; i < 3; i++) most = largest(most, fabs(displacement[i]));
  const double part = most > longest ? longest / most : 1.0;
  for (int i = 0; i < 3; i++) displacement[i] *= part;
  const double length = sqrt(dot3(displacement, displacement));
  if (length > longest)
    for (int i = 0; i < 3; i++) displacement[i] *= longest / length;
}

/* The target's own twist, zero where it was at rest, came into being or jumped. */
static void target_twist(const r47_follow *f, int k, const double *J, double *twist) {
  const double *target = f->target + 7 * f->tool[k];
  double *last = f->last + 7 * f->tool[k];
  if (f->known[f->tool[k]]) {
    for (int i = 0; i < 3; i++) twist[i] = (target[4 + i] - last[4 + i]) / f->dt;
    turned(f, target, last, twist + 3);
    for (int i = 3; i < 6; i++) twist[i] /= f->dt;
    for (int i = 0; i < 6; i++) {
      double fastest = 0.0;
      for (int j = 0; j < f->n; j++) fastest += fabs(J[i * f->n + j]) * f->v_max[j];
      if (fabs(twist[i]) > fastest) f->jumped[k] = 1;
    }
  }
  if (f->jumped[k] || !f->known[f->tool[k]]) memset(twist, 0, 6 * sizeof(double));
  memcpy(last, target, 7 * sizeof(double));
  f->known[f->tool[k]] = 1;
}

/* Fills the rows of tool k: Jacobian, way and twist. */
static void measure(r47_follow *f, int k, double *J, double *way, double *twist) {
  const int n = f->n, tool = f->tool[k];
  jacobian(f, k, J);
  f->jumped[k] = 0;
  memset(way, 0, 6 * sizeof(double));
  memset(twist, 0, 6 * sizeof(double));
  if (f->given[tool]) {
    const double *target = f->target + 7 * tool, *p = f->site_xpos + 3 * f->site[k];
    for (int i = 0; i < 3; i++) way[i] = target[4 + i] - p[i];
    turned(f, target, f->site_xquat + 4 * f->site[k], way + 3);
    f->away = largest(f->away, dot3(way, way));
    f->turn = largest(f->turn, dot3(way + 3, way + 3));
    shorten(way, f->max_distance);
    target_twist(f, k, J, twist);
  } else {
    f->known[tool] = 0;
  }
  for (int i = 0; i < 6; i++) {
    const double unit = i < 3 ? 1.0 : f->radian_length;
    way[i] *= unit, twist[i] *= unit;
    for (int j = 0; j < n; j++) J[i * n + j] *= f->frozen[j] ? 0.0 : unit;
  }
}

/* Cholesky factor of A (m, m) with the inverses of its diagonal; nonzero where there is none. */
static int factorise(int m, const double *A, double *L) {
  for (int i = 0; i < m; i++)
    for (int j = 0; j <= i; j++) {
      double left = A[i * m + j];
      for (int k = 0; k < j; k++) left -= L[i * m + k] * L[j * m + k];
      if (j < i)
        L[i * m + j] = left * L[j * m + j];
      else if (left > 0.0)
        L[i * m + i] = 1.0 / sqrt(left);
      else
        return 1;
    }
  return 0;
}

/* Eigenvalues of A (m, m) on its diagonal, eigenvectors in the columns of U, by Jacobi rotations.
 */
static void diagonalise(int m, double *A, double *U) {
  for (int i = 0; i < m; i++)
    for (int j = 0; j < m; j++) U[i * m + j] = i == j;
  for (int sweep = 0; sweep < 30; sweep++) {
    int turns = 0;
    for (int p = 0; p < m; p++)
      for (int q = p + 1; q < m; q++) {
        const double off = A[p * m + q], a = A[p * m + p], b = A[q * m + q];
        if (fabs(off) <= 1e-17 * (fabs(a) + fabs(b)) || off == 0.0) continue;
        turns++;
        const double half = (b - a) / (2.0 * off);
        const double t = (half < 0.0 ? -1.0 : 1.0) / (fabs(half) + sqrt(half * half + 1.0));
        const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
        for (int k = 0; k < m; k++) {
          const double x = A[k * m + p], y = A[k * m + q];
          A[k * m + p] = c * x - s * y, A[k * m + q] = s * x + c * y;
        }
        for (int k = 0; k < m; k++) {
          const double x = A[p * m + k], y = A[q * m + k];
          A[p * m + k] = c * x - s * y, A[q * m + k] = s * x + c * y;
          const double u = U[k * m + p], v = U[k * m + q];
          U[k * m + p] = c * u - s * v, U[k * m + q] = s * u + c * v;
        }
        A[p * m + q] = A[q * m + p] = 0.0;
      }
    if (!turns) return;
  }
}

/* x := U diag(1 / weight) Uᵀ x, without those of no weight. */
static void spread(int m, const double *U, const double *weight, double *x, double *memory) {
  for (int i = 0; i < m; i++) {
    double along = 0.0;
    for (int k = 0; k < m; k++) along += U[k * m + i] * x[k];
    memory[i] = weight[i] > 0.0 ? along / weight[i] : 0.0;
  }
  for (int k = 0; k < m; k++) {
    x[k] = 0.0;
    for (int i = 0; i < m; i++) x[k] += U[k * m + i] * memory[i];
  }
}

static void by_eigenvalues(const r47_follow *f, int m, double *way, double *twist, double *home) {
  double *A = f->squares, *U = A + m * m, *damping = U + m * m, *exact = damping + m;
  double *memory = exact + m, most = f->tiny;
  diagonalise(m, A, U);
  for (int i = 0; i < m; i++) most = largest(most, A[i * m + i]);
  const double zero = f->threshold * f->threshold * most;
  for (int i = 0; i < m; i++) {
    const double square = largest(A[i * m + i], 0.0), lacking = largest(zero - square, 0.0);
    damping[i] = lacking * lacking / (4.0 * zero) + square;
    exact[i] = square > f->lost * most ? largest(square, f->tiny) : 0.0;
  }
  spread(m, U, damping, way, memory);
  spread(m, U, damping, twist, memory);
  spread(m, U, exact, home, memory);
}

/* The inverse of J Jᵀ times way and twist, damped as by DampedInverse, and times home. */
static void invert(const r47_follow *f, int m, double *way, double *twist, double *home) {
  const int n = f->n;
  double *A = f->squares, *L = A + m * m, *lessened = L + m * m, trace = 0.0;
  for (int i = 0; i < m; i++) {
    for (int k = 0; k <= i; k++) {
      double sum = 0.0;
      for (int j = 0; j < n; j++) sum += f->J[i * n + j] * f->J[k * n + j];
      A[i * m + k] = A[k * m + i] = sum;
    }
    trace += A[i * m + i];
  }
  memcpy(lessened, A, (size_t)m * m * sizeof(double));
  const double reserve = largest(f->threshold * f->threshold, f->lost) * trace;
  for (int i = 0; i < m; i++) lessened[i * m + i] -= reserve;
  if (factorise(m, lessened, L) || factorise(m, A, L)) {
    by_eigenvalues(f, m, way, twist, home);
    return;
  }
  r47_cholesky_solve(m, L, way);
  r47_cholesky_solve(m, L, twist);
  r47_cholesky_solve(m, L, home);
}

/* See approach_rate in target_velocity.py. */
static double approach_rate(const r47_follow *f, int group) {
  double pace = f->gain;
  for (int j = 0; j < f->n; j++) {
    if (f->group[j] != group) continue;
    const double d = fabs(f->way[j]), soft = f->a_use[j] / (f->gain * f->gain);
    if (d > soft) pace = least(pace, sqrt(f->a_use[j] * (2.0 * d - soft)) / d);
    if (pace * d > f->v_use[j]) pace = f->v_use[j] / d;
  }
  return pace;
}

static double times_column(const double *J, const double *x, int m, int n, int j) {
  double sum = 0.0;
  for (int i = 0; i < m; i++) sum += J[i * n + j] * x[i];
  return sum;
}

void r47_follow_targets(r47_follow *f, const double *q) {
  const int n = f->n, m = 6 * f->tools;
  double *way = f->rows, *twist = way + m, *home = twist + m, back[R47_MAX_N];
  memcpy(f->qpos, q, (size_t)n * sizeof(double));
  ((update)f->kinematics)(f->model, f->data);
  ((update)f->centres)(f->model, f->data);
  f->away = f->turn = 0.0;
  for (int k = 0; k < f->tools; k++)
    measure(f, k, f->J + (size_t)6 * k * n, way + 6 * k, twist + 6 * k);
  for (int j = 0; j < n; j++) {
    back[j] = clipped(f->home_gain * (f->home[j] - q[j]), -f->v_home[j], f->v_home[j]);
    if (f->frozen[j]) back[j] = 0.0;
  }
  for (int i = 0; i < m; i++) {
    home[i] = 0.0;
    for (int j = 0; j < n; j++) home[i] += f->J[i * n + j] * back[j];
  }
  invert(f, m, way, twist, home);
  for (int j = 0; j < n; j++) f->way[j] = times_column(f->J, way, m, n, j), f->paced[j] = 0.0;
  for (int group = 0; group < f->groups; group++) {
    const double pace = approach_rate(f, group);
    for (int j = 0; j < n; j++)
      if (f->group[j] == group) f->paced[j] = pace * f->way[j];
  }
  for (int j = 0; j < n; j++) {
    f->v_ref[j] = f->paced[j] + times_column(f->J, twist, m, n, j) + back[j] -
                  times_column(f->J, home, m, n, j);
    for (int i = 0; i <= j; i++) {
      double sum = i == j ? f->joint_weight : 0.0;
      for (int k = 0; k < m; k++) sum += f->J[k * n + i] * f->J[k * n + j];
      f->H[i * n + j] = f->H[j * n + i] = sum;
    }
  }
}
