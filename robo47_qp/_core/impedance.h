/* A spring and a damper between the tool and its reference; see CartesianImpedance. */
#ifndef ROBO47_IMPEDANCE_H
#define ROBO47_IMPEDANCE_H

#include "tool_space.h"

typedef struct {
  r47_tool_space *space;
  const double *stiffness, *most, *rate; /* (6,) of a spring; its largest error; 2 zeta sqrt(K) */
  double posture_stiffness, posture_damping;
} r47_impedance;

/* The torque tau (n,), from references and state (n,). */
void r47_impedance_torque(const r47_impedance *impedance, const double *q_ref, const double *v_ref,
                          const double *a_ref, const double *q, const double *v, double *tau);

#endif
