#include "impedance.h"

#include "elementary_inline.h"
#include "linear_inline.h"

/* f(e) + D J (v_ref - v), along the axes of the tool space, from the twist J (v_ref - v). */
static void wrench(const r47_impedance *c, const double *twist, double *force) {
  const r47_tool_space *s = c->space;
  const double *rotation = s->rotation + 1;
  double held[6], cross[3];
  for (int i = 0; i < 6; i++) {
    const double e = i < 3 ? s->error[i] : 2.0 * rotation[i - 3];
    held[i] = c->stiffness[i] * clipped(e, -c->most[i], c->most[i]);
  }
  /* The gradient of the potential 2 eps^T K eps: 2 (eta K eps - eps x K eps). */
  cross3(rotation, held + 3, cross);
  for (int i = 0; i < 3; i++) {
    force[i] = held[i];
    force[3 + i] = s->rotation[0] * held[3 + i] - cross[i];
  }
  for (int i = 0; i < 6; i++) force[i] += c->rate[i] * sqrt(s->inertia[7 * i]) * twist[i];
}

void r47_impedance_torque(const r47_impedance *c, const double *q_ref, const double *v_ref,
                          const double *a_ref, const double *q, const double *v, double *tau) {
  r47_tool_space *s = c->space;
  r47_dynamics *arm = s->arm;
  const int n = arm->n;
  double wanted[R47_MAX_N], posture[R47_MAX_N], error_v[R47_MAX_N], unfelt[R47_MAX_N];
  double twist[6], force[6], missing[6], cancelling[6];
  for (int i = 0; i < n; i++) {
    error_v[i] = v_ref[i] - v[i];
    wanted[i] = c->posture_stiffness * (q_ref[i] - q[i]) + c->posture_damping * error_v[i];
  }
  r47_tool_place(s, q_ref, q);
  r47_tool_twist(s, wanted, twist);
  r47_tool_null(s, wanted, twist, posture);
  r47_tool_twist(s, error_v, twist);
  r47_tool_null(s, error_v, twist, unfelt);
  for (int i = 0; i < n; i++) {
    arm->qvel[i] = v_ref[i] - unfelt[i];
    arm->qacc[i] = a_ref[i] + posture[i];
  }
  r47_inverse_here(arm);
  wrench(c, twist, force);
  /* The tool acceleration J' v of the null-space motion. */
  r47_tool_rate_times(s, unfelt, missing);
  r47_tool_inertia_times(s, missing, cancelling);
  for (int i = 0; i < 6; i++) force[i] += cancelling[i];
  for (int k = 0; k < n; k++) {
    tau[k] = 0.0;
    for (int i = 0; i < 6; i++) tau[k] += s->J[i * n + k] * force[i];
    tau[k] += arm->qfrc_inverse[k];
  }
}
