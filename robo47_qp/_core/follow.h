/* The joint velocity towards targets of tools; see TargetVelocity. */
#ifndef ROBO47_FOLLOW_H
#define ROBO47_FOLLOW_H

#include "chain.h"

typedef struct {
  int n, tools, groups;                      /* tools that are followed together */
  void *model, *data, *kinematics, *centres; /* mj_kinematics, mj_comPos */
  void *difference, *rotated;                /* mju_subQuat, mju_rotVecQuat */
  double *qpos;                              /* (n,) of the data */
  const double *site_xpos, *site_xquat, *cdof, *com;
  const int *root;            /* (n,) centre of mass that cdof is about */
  const int *tool, *site;     /* (tools,) */
  const unsigned char *moves; /* (tools, n) joints that move a tool */
  const unsigned char *frozen;
  const int *group; /* (n,) joints of one pace; -1 for those that move no tool */
  const double *home, *v_home, *v_max, *v_use, *a_use; /* (n,) */
  double gain, home_gain, threshold, lost, tiny, max_distance, radian_length, joint_weight, dt;
  /* Of all tools of the arm: target as quaternion and position (all, 7), whether there is one,
     and the same at the last call. */
  const double *target;
  const unsigned char *given;
  double *last;
  unsigned char *known;
  /* Results: Jacobian (6 tools, n) in metres, weights (n, n), velocities and ways (n,), the largest
     squared errors, and which targets jumped (tools,). */
  double *J, *H, *v_ref, *way, *paced;
  double away, turn;
  unsigned char *jumped;
  double *rows;    /* (4, 6 tools) memory */
  double *squares; /* (3, 6 tools, 6 tools) */
} r47_follow;

/* The velocity at q (n,); the data is brought up to date. */
void r47_follow_targets(r47_follow *follow, const double *q);

#endif
