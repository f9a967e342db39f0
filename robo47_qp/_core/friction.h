/* Dry friction of joints, learned from what an observer sees; see FrictionLearning. */
#ifndef ROBO47_FRICTION_H
#define ROBO47_FRICTION_H

#include "chain.h"

/* Arrays are (n,) unless said; those of variances are of b, of b with f, and of f. */
typedef struct {
  int n;
  void *model, *data; /* the arm's, with the mass matrix of its last inverse dynamics */
  void *solve, *mass; /* mj_solveM, mj_mulM */
  double per_update, settling;
  double per_displacement, per_start; /* of z; the latter where joints start from rest */
  double slow;                        /* displacement in an update, below which a joint may stick */
  double loose;                       /* displacement after which it does not */
  double creeps; /* that below which a reversal is partly left to the observer */
  int started;
  int count, learning; /* updates until now, and how many there are to each step of learning */
  double *q;           /* the reference of the last update */
  double *z;           /* direction of motion, -1 to 1 */
  double *gone;        /* displacement since z changed, or the reference rested */
  double *since;       /* time since z changed, or the joint may have stuck [s] */
  double *rested;      /* (1,) time since the reference moved [s] */
  double *moving;      /* (1,) time since the reference rested [s] */
  double *b, *f;       /* what was learned */
  const double *most;
  double bias;
  double *bears; /* gravity and Coriolis torques of this call */
  double *borne; /* those of the last one */
  double *P_bb, *P_bf, *P_ff;
  const double *Q_bb, *Q_ff, *R;
  double *given;  /* the reference, or the disturbance, of this call */
  int free;       /* whether friction is what holds joints at rest */
  double *held;   /* the disturbance, if so */
  double *change; /* change of the joints' acceleration */
} r47_friction;

/* Takes the reference in `given`; returns whether there is a change. */
int r47_friction_change(r47_friction *friction);

/* Learns from the disturbance in `given`, to be called after every change. */
void r47_friction_learn(r47_friction *friction);

#endif
