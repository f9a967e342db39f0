#include "box_qp.h"

#include "chain.h"
#include "elementary_inline.h"

/* An unknown beyond its bound by less than this is at it: rounding alone moves none [rad]. */
static const double ROUNDING = 1e-13;
/* Exchanges of whole blocks that bring no progress before single ones follow. */
enum { PATIENCE = 8 };

/* Cholesky factor of the rows and columns `at` (m,) of H, with the inverses of its diagonal;
   nonzero where they are not positive definite. */
static int factorise(int n, const double *H, int m, const int *at, double *L) {
  for (int i = 0; i < m; i++) {
    for (int j = 0; j <= i; j++) {
      double left = H[at[i] * n + at[j]];
      for (int k = 0; k < j; k++) left -= L[i * m + k] * L[j * m + k];
      if (j < i)
        L[i * m + j] = left * L[j * m + j];
      else if (left > 0.0)
        L[i * m + i] = 1.0 / sqrt(left); /* the inverse: a division each instead of many */
      else
        return 1;
    }
  }
  return 0;
}

void r47_cholesky_solve(int n, const double *L, double *x) {
  for (int i = 0; i < n; i++) {
    for (int k = 0; k < i; k++) x[i] -= L[i * n + k] * x[k];
    x[i] *= L[i * n + i];
  }
  for (int i = n - 1; i >= 0; i--) {
    for (int k = i + 1; k < n; k++) x[i] -= L[k * n + i] * x[k];
    x[i] *= L[i * n + i];
  }
}

/* The minimiser where those with a side are at their bounds and the others are free. */
static int solve_free(int n, const double *H, const double *f, const double *low,
                      const double *high, const int *side, double *x, double *L) {
  int at[R47_MAX_N], m = 0;
  double free[R47_MAX_N];
  for (int i = 0; i < n; i++) {
    if (side[i] == 0)
      at[m++] = i;
    else
      x[i] = side[i] < 0 ? low[i] : high[i];
  }
  if (factorise(n, H, m, at, L)) return -1;
  for (int i = 0; i < m; i++) {
    free[i] = -f[at[i]];
    if (m < n)
      for (int j = 0; j < n; j++)
        if (side[j]) free[i] -= H[at[i] * n + j] * x[j];
  }
  r47_cholesky_solve(m, L, free);
  for (int i = 0; i < m; i++) x[at[i]] = free[i];
  return m;
}

/* Where an unknown belongs, given the minimiser for the present sides. */
static int wanted(int n, const double *H, const double *f, const double *low, const double *high,
                  const double *x, const int *side, int i) {
  if (side[i] == 0) {
    if (x[i] < low[i] - ROUNDING) return -1;
    return x[i] > high[i] + ROUNDING ? 1 : 0;
  }
  if (low[i] >= high[i]) return side[i];
  double slope = f[i];
  for (int j = 0; j < n; j++) slope += H[i * n + j] * x[j];
  return slope * side[i] > 0.0 ? 0 : side[i];
}

/* Block principal pivoting: all unknowns that are beyond a bound, or held by a bound that pushes
   them inwards, change sides at once; after exchanges that bring no progress one at a time, the
   last in order, which is finite (Júdice and Pires, "A block principal pivoting algorithm for
   large-scale strictly monotone linear complementarity problems", 1994; Murty, 1974). */
int r47_box_qp(int n, const double *H, const double *f, const double *low, const double *high,
               double *x, int *side, double *L) {
  int fewest = n + 1, patience = PATIENCE, m = 0;
  for (int i = 0; i < n; i++) side[i] = 0;
  for (int round = 0; round < 20 * (n + 1); round++) {
    m = solve_free(n, H, f, low, high, side, x, L);
    if (m < 0) return -1;
    int next[R47_MAX_N], changes = 0, last = 0;
    for (int i = 0; i < n; i++) {
      next[i] = wanted(n, H, f, low, high, x, side, i);
      if (next[i] != side[i]) changes++, last = i;
    }
    if (changes == 0) break;
    if (changes < fewest)
      fewest = changes, patience = PATIENCE;
    else if (patience > 0)
      patience--;
    if (patience > 0)
      memcpy(side, next, (size_t)n * sizeof(int));
    else
      side[last] = next[last];
  }
  /* What remains after so many rounds is rounding: an unknown at a bound in either way. */
  for (int i = 0; i < n; i++) x[i] = least(largest(x[i], low[i]), high[i]);
  return m;
}
