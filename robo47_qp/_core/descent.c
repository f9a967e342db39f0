#include "descent.h"

#include "box_qp.h"
#include "elementary_inline.h"
#include "linear_inline.h"
#include "pose_error.h"

enum { N = R47_MAX_N, ROWS = 6 * R47_MAX_TOOLS };

/* A longer change of a step than this is none of rounding [rad]. */
static const double ROUNDING = 1e-6;

typedef struct {
  double links[12 * N];
  double tool[12 * R47_MAX_TOOLS]; /* frames of the tools at the last `measure` */
  double e[ROWS];                  /* displacements and rotation vectors */
  double distance2, angle2;
} place;

static void measure(const r47_descent *d, const double *targets, const double *q, place *at) {
  r47_links(d->chain, q, at->links);
  at->distance2 = at->angle2 = 0.0;
  for (int i = 0; i < d->tools; i++) {
    double *e = at->e + 6 * i;
    r47_frame(d->chain, at->links, d->tool[i], at->tool + 12 * i);
    r47_pose_error(at->tool + 12 * i, targets + 12 * i, e);
    if (!d->oriented) e[3] = e[4] = e[5] = 0.0;
    at->distance2 += dot3(e, e);
    at->angle2 += dot3(e + 3, e + 3);
  }
}

/* Residual r (rows,) and how it falls per joint, J (rows, n); returns the rows of all tools. */
static int linearise(const r47_descent *d, const place *at, double *r, double *J) {
  const int n = d->chain->n, rows = d->turns ? 6 : 3;
  for (int i = 0; i < d->tools; i++) {
    double own[6 * N], *J_i = J + rows * i * n, *r_i = r + rows * i;
    const double *e = at->e + 6 * i;
    r47_jacobian(d->chain, at->links, d->chain->joint[d->tool[i]], at->tool + 12 * i + 9, own);
    if (!d->logarithm) {
      memcpy(r_i, e, (size_t)rows * sizeof(double));
      memcpy(J_i, own, (size_t)(rows * n) * sizeof(double));
      continue;
    }
    double A[9], B[9];
    r47_pose_log(e, r_i, A, B);
    for (int k = 0; k < n; k++) {
      const double v[3] = {own[k], own[n + k], own[2 * n + k]};
      const double w[3] = {own[3 * n + k], own[4 * n + k], own[5 * n + k]};
      for (int row = 0; row < 3; row++) {
        J_i[row * n + k] = dot3(A + 3 * row, v) + dot3(B + 3 * row, w);
        J_i[(3 + row) * n + k] = dot3(A + 3 * row, w);
      }
    }
  }
  return rows * d->tools;
}

/* out := Jᵀ r */
static void gradient(int rows, int n, const double *J, const double *r, double *out) {
  memset(out, 0, (size_t)n * sizeof(double));
  for (int row = 0; row < rows; row++)
    for (int i = 0; i < n; i++) out[i] += J[row * n + i] * r[row];
}

static void normal_matrix(int rows, int n, const double *J, double damping, double *H) {
  memset(H, 0, (size_t)(n * n) * sizeof(double));
  for (int row = 0; row < rows; row++)
    for (int i = 0; i < n; i++)
      for (int j = 0; j <= i; j++) H[i * n + j] += J[row * n + i] * J[row * n + j];
  for (int i = 0; i < n; i++) {
    H[i * n + i] += damping;
    for (int j = 0; j < i; j++) H[j * n + i] = H[i * n + j];
  }
}

/* One refinement of the joints that no bound holds. The residual is taken from J, which has all
   digits, and not from H = JᵀJ + λ1 (Björck, "Iterative refinement of linear least squares
   solutions", 1967). */
static void refine(int rows, int n, const double *J, const double *r, double damping,
                   const double *lean, const int *side, int between, const double *L, double *dq) {
  double left[ROWS], fall[N], change[N], length2 = 0.0;
  for (int row = 0; row < rows; row++) {
    left[row] = r[row];
    for (int i = 0; i < n; i++) left[row] -= J[row * n + i] * dq[i];
  }
  gradient(rows, n, J, left, fall);
  for (int i = 0, k = 0; i < n; i++)
    if (side[i] == 0) change[k++] = fall[i] - damping * dq[i] + lean[i];
  r47_cholesky_solve(between, L, change);
  for (int k = 0; k < between; k++) length2 += change[k] * change[k];
  if (!(length2 <= ROUNDING * ROUNDING)) return;
  for (int i = 0, k = 0; i < n; i++)
    if (side[i] == 0) dq[i] += change[k++];
}

/* min over dq of ½ ‖J dq - r‖² + ½ λ ‖dq‖² + ½ w ‖dq - (q_seed - q)‖² within the limits. */
static int step_from(const r47_descent *d, const place *at, const double *q_seed, const double *q,
                     double *dq) {
  const int n = d->chain->n;
  double r[ROWS], J[ROWS * N], H[N * N], L[N * N], f[N], lean[N], low[N], high[N];
  int side[N];
  const int rows = linearise(d, at, r, J);
  double squared = d->turns ? at->distance2 + at->angle2 : at->distance2;
  if (d->logarithm) {
    squared = 0.0;
    for (int row = 0; row < rows; row++) squared += r[row] * r[row];
  }
  const double w = d->logarithm ? d->posture * squared : 0.0;
  const double damping = d->damping * squared + w + d->floor;
  normal_matrix(rows, n, J, damping, H);
  gradient(rows, n, J, r, f);
  for (int i = 0; i < n; i++) {
    lean[i] = w * (q_seed[i] - q[i]);
    f[i] = -(f[i] + lean[i]);
    low[i] = d->q_min[i] - q[i];
    high[i] = d->q_max[i] - q[i];
  }
  const int between = r47_box_qp(n, H, f, low, high, dq, side, L);
  if (between < 0) return 0;
  refine(rows, n, J, r, damping, lean, side, between, L, dq);
  for (int i = 0; i < n; i++) dq[i] = least(largest(dq[i], low[i]), high[i]);
  return 1;
}

static void clip(const r47_descent *d, double *q) {
  for (int i = 0; i < d->chain->n; i++) q[i] = least(largest(q[i], d->q_min[i]), d->q_max[i]);
}

void r47_descend(const r47_descent *d, const double *targets, const double *q_seed, double *q,
                 r47_end *end) {
  place at;
  double frames[12 * R47_MAX_TOOLS], past[R47_MAX_STALL], dq[N];
  for (int i = 0; i < d->tools; i++) r47_frame_of(targets + 7 * i, frames + 12 * i);
  const double close = d->position * d->position;
  const double aligned = d->turns ? d->orientation * d->orientation : INFINITY;
  clip(d, q);
  end->reached = 0;
  for (int iteration = 0;; iteration++) {
    end->iterations = iteration;
    measure(d, frames, q, &at);
    if (at.distance2 <= close && at.angle2 <= aligned) {
      end->reached = 1;
      break;
    }
    if (d->stall_steps > 0) {
      const double squared = d->turns ? at.distance2 + at.angle2 : at.distance2;
      double *before = past + iteration % d->stall_steps;
      if (iteration >= d->stall_steps && squared > (1.0 - d->stall_fall) * *before) break;
      *before = squared;
    }
    if (iteration == d->max_iterations || !step_from(d, &at, q_seed, q, dq)) break;
    for (int i = 0; i < d->chain->n; i++) q[i] += dq[i];
  }
  clip(d, q);
  end->distance2 = at.distance2;
  end->angle2 = at.angle2;
}

int r47_step(const r47_descent *d, const double *targets, const double *q_seed, const double *q,
             double *dq) {
  place at;
  double frames[12 * R47_MAX_TOOLS];
  for (int i = 0; i < d->tools; i++) r47_frame_of(targets + 7 * i, frames + 12 * i);
  measure(d, frames, q, &at);
  return step_from(d, &at, q_seed, q, dq);
}
