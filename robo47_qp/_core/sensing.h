/* What a world with errors does in every control period: delays, and sensors at joints and wrist.
 */
#ifndef ROBO47_SENSING_H
#define ROBO47_SENSING_H

/* Random numbers drawn ahead, of which each period takes `width`; see Draws. */
typedef struct {
  int width;
  const double *rows;
  long long *at; /* the next row */
} r47_draws;

/* A signal of `k` numbers as it arrives some time later; see Delay. */
typedef struct {
  int k, length;
  double *past;           /* (length, k), a ring */
  long long *newest;      /* place in it of the last sample */
  double *late;           /* how many periods late it is now */
  const r47_draws *drawn; /* how many it may be, drawn in every period; NULL where it stays */
} r47_delay;

/* Positions of the joints with noise and late, and velocities; see JointSensor. */
typedef struct {
  int n;
  r47_delay *delay; /* of q and v in one piece */
  double noise;
  const r47_draws *drawn; /* (n,) each; NULL without noise */
  int exact;              /* whether velocities are measured; else they are estimated: */
  double share, period;
  double *q, *v; /* (n,) as measured last */
} r47_joint_sensor;

/* Errors of the forces at the wrists; see ForceSensor. */
typedef struct {
  int n;                  /* three for each */
  const r47_draws *drawn; /* (2, n) each */
  double keep, fresh, noise;
  double *offset, *error; /* (n,) */
} r47_force_sensor;

/* Each is NULL where there is none. */
typedef struct {
  r47_delay *torque;
  r47_joint_sensor *joints;
  r47_force_sensor *force;
} r47_senses;

/* Adds the value (k,) of this period and writes the one that arrives in it. */
void r47_delay_sample(r47_delay *delay, const double *value, double *arrived);

/* Measures at the end of a period with the true q and v (n,). */
void r47_sense(r47_senses *senses, const double *q, const double *v);

#endif
