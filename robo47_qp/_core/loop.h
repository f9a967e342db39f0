/* Control periods of an arm in its world, one row of the recording each. */
#ifndef ROBO47_LOOP_H
#define ROBO47_LOOP_H

#include "control.h"
#include "sensing.h"

/* The world: MuJoCo's model and data, motors, grippers, and what is recorded of it. */
typedef struct {
  int n;
  void *model, *data;
  void *step1, *step2; /* mj_step1, mj_step2 */
  void **clock;        /* mjcb_time, which MuJoCo reads many times in a step */
  double *q, *v;       /* (n,) of the data; where that has them in pieces, copies of it */
  r47_senses *senses;  /* errors of sensors and lines; NULL without */
  double *ctrl;        /* (n,) torques of the motors, likewise */
  int pieces;          /* of the joints in the data; 0 where they are one */
  const long long *q_at, *v_at, *ctrl_at; /* (pieces,) address of each */
  const int *length;                      /* (pieces,) joints of each */
  const double *most, *rate;
  int grippers;
  double *all_ctrl;
  const int *servo;                   /* (grippers,) place of the servo in all_ctrl */
  const double *width;                /* (grippers,) where each goes */
  const double *speed;                /* (grippers,) by how much in a period */
  const double *unloaded, *unloading; /* (grippers,) below what by how much instead */
  int tools;
  const long long *whole, *within; /* (tools,) addresses of forces (3,) */
  double *force;                   /* (tools, 3): within - whole */
  const double *touch;             /* (touches,) zero where nothing touches what is summed */
  int touches;
  double *sums; /* (summed,) the sums of magnitudes, which are then zero */
  int summed;
  int first, firsts;     /* columns at the start of a period, and pieces that fill them */
  int late, lates;       /* columns of what has happened, and pieces that fill them */
  const long long *from; /* (firsts + lates,) address of each piece */
  const int *size;       /* (firsts + lates,) numbers of each piece */
} r47_world;

/* Go on for `periods` control periods with references (periods, n) each, fill rows of `width`
   numbers and add to `filled` as each is complete.

   `command` is the column of the commanded torques. Returns how many periods were begun; less than
   nothing if the caller has to complete the last: where something touches, the columns `late` are
   to be filled; where the torque, in control->last, is not finite, nothing has moved in it. */
int r47_run(r47_control *control, r47_world *world, int periods, const double *q_ref,
            const double *v_ref, const double *a_ref, double *rows, int width, int command,
            long long *filled);

#endif
