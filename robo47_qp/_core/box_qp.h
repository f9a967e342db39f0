/* Strictly convex QPs with bounds. */
#ifndef ROBO47_BOX_QP_H
#define ROBO47_BOX_QP_H

/* min over x of ½ xᵀ H x + fᵀ x subject to low <= x <= high, by block principal pivoting.

   n:    unknowns, 64 at most
   H:    positive definite (n, n)
   x:    minimiser (n,)
   side: -1 where x is at its lower bound, 1 at its upper one, 0 between (n,)
   L:    Cholesky factor of H's rows and columns of the unknowns between their bounds, with the
         inverses of its diagonal in place of it (free, free); room for (n, n)

   Returns the number of unknowns between their bounds, or -1 where H is not positive definite. */
int r47_box_qp(int n, const double *H, const double *f, const double *low, const double *high,
               double *x, int *side, double *L);

/* x := (L Lᵀ)⁻¹ x for a factor L (n, n) of `r47_box_qp`. */
void r47_cholesky_solve(int n, const double *L, double *x);

#endif
