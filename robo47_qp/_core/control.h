/* One control period: the observer's estimate, the control law, its limits. */
#ifndef ROBO47_CONTROL_H
#define ROBO47_CONTROL_H

#include "friction.h"
#include "impedance.h"

enum { R47_COMPUTED_TORQUE = 1, R47_JOINT_IMPEDANCE = 2, R47_CARTESIAN_IMPEDANCE = 3 };

/* Arrays are (n,) unless said. */
typedef struct {
  int n;
  r47_dynamics *arm; /* as it is believed to be */
  /* The law, with e the errors: computed torque asks for a_ref + stiffness e + damping e_v, joint
     impedance for a_ref; both add K e + D e_v where K is not NULL; the third is its own. */
  int law;
  const r47_impedance *impedance;
  double stiffness, damping;
  const double *K, *D;
  /* Limits: change of the torque per period, torque, positions between which no joint stop acts;
     strength tau_max of the stops and their squared width, and the joints' ranges. */
  const double *rate, *most, *low, *high, *stop, *square, *q_min, *q_max;
  double *last;      /* the torque of the last period [N m] */
  double *commanded; /* that of this one before its limits [N m] */
  /* A difference that fades after a switch, and how many of `fade` periods are left of it. */
  const double *bump;
  int fade, left;
  /* The observer, if there is one: q, v, d in `estimate` (3 n), from the expected acceleration and
     the measured q by `filter` (3, 5, n); see DisturbanceObserver. */
  int observed;
  const double *filter;
  double *estimate, *expected;
  int on, follows;
  double least;
  const double *bound;
  double *compensation;
  const double *offset;
  int observer_fade, observer_left;
  /* Measured positions that are late by a time that changes; floor is 0 without. See Jitter. */
  double jitter_floor, jitter_share;
  double *jitter;     /* (1,) what is kept of it [s] */
  const double *next; /* (2, 4) from q, v, d, a to q and v a period later */
  /* Known delays: `delay` periods in all, of which the command is `ahead` [s]; the accelerations
     (delay, n) that are still to be seen, and from q, v, d and them to the q and v at which the
     next command is felt. */
  int delay;
  double ahead, period;
  double *pending;
  const double *predict; /* (2, 3 + delay) */
  double *tracked;       /* positions of the reference as the law had them last */
  int turning;           /* whether d changes by `turned` in every period */
  double *turned;
  /* Friction is updated after every `periods`, next in `until` of them; never where that is 0.
     It is not learned soon after a contact, and in one, it is not what holds joints at rest. */
  r47_friction *friction;
  int periods, until, learns, free;
  /* Tools hold one body: of what is beyond `base`, `shares` (n, n) are compensated. */
  int closed;
  double *base;
  const double *shares;
} r47_control;

/* The torques tau (periods, n) for periods that start with references and states (periods, n),
   within the limits; v is not used by an observer. */
void r47_torques(r47_control *control, int periods, const double *q_ref, const double *v_ref,
                 const double *a_ref, const double *q, const double *v, double *tau);

/* The same for one period, but the mass matrix of the arm may be without its factors. */
void r47_next_torque(r47_control *control, const double *q_ref, const double *v_ref,
                     const double *a_ref, const double *q, const double *v, double *tau);

#endif
