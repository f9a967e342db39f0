/* Inverse dynamics of an arm without contacts, by the parts of mj_inverse that it needs. */
#ifndef ROBO47_DYNAMICS_H
#define ROBO47_DYNAMICS_H

#include "chain.h"

/* MuJoCo's functions and structures come as pointers, so that the core needs neither its headers
   nor its library. */
typedef struct {
  int n;
  void *model, *data;
  void *kinematics; /* mj_kinematics */
  void *centres;    /* mj_comPos */
  void *mass;       /* mj_makeM */
  void *factor;     /* mj_factorM */
  void *times;      /* mj_mulM */
  void *solve;      /* mj_solveM */
  void *velocities; /* mj_comVel */
  void *passive;    /* mj_passive */
  void *bias;       /* mj_rne */
  /* Of the data, (n,) each: read, then written. */
  double *qpos, *qvel, *qacc;
  const double *qfrc_passive;
  double *qfrc_bias, *qfrc_inverse;
  int factored; /* whether the mass matrix of the last call has its factors */
} r47_dynamics;

/* The torques qfrc_inverse for qpos, qvel, qacc: to the bit those of mj_inverse. */
void r47_inverse(r47_dynamics *dynamics);

/* The first half of it, for qpos alone, and the second. */
void r47_place(r47_dynamics *dynamics);
void r47_inverse_here(r47_dynamics *dynamics);

/* The factors of the mass matrix of the last r47_place or r47_inverse. */
void r47_factor(r47_dynamics *dynamics);

/* x = M^-1 y, likewise, for each of the rows (n,) of y. */
void r47_solve(r47_dynamics *dynamics, double *x, const double *y, int rows);

#endif
