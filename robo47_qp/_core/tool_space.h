/* The dynamics of an arm in the coordinates of its tool; see ToolSpace. */
#ifndef ROBO47_TOOL_SPACE_H
#define ROBO47_TOOL_SPACE_H

#include "dynamics.h"

typedef struct {
  r47_dynamics *arm;
  void *jacobian, *jacobian_rate; /* mj_jacSite, mj_jacDot */
  int site, body;                 /* the tool's frame, and the body that it is on */
  const double *position, *quaternion;
  void *data; /* of the same model, at the reference; `placed` is nonzero once it is at `q` */
  int placed;
  double *q;
  const double *position_ref, *quaternion_ref, *rotation_ref;
  int in_tool;            /* the axes of all below: the tool's at its reference, or the world's */
  const double *lightest; /* (6,) inverse of the largest inertia along each axis */
  /* Filled by r47_tool_place. */
  double *J;        /* (6, n), linear part first */
  double *J_over_M; /* (6, n) the rows of J M^-1 */
  double *inertia;  /* (6, 6) */
  double *error;    /* (3,) displacement from the tool to its reference [m] */
  double *rotation; /* (4,) unit quaternion wxyz, of either sign, from the tool to its reference */
} r47_tool_space;

/* Moves the arm to q, factors of its mass matrix included, and the reference to q_ref. */
void r47_tool_place(r47_tool_space *space, const double *q_ref, const double *q);

/* product (6,) = J x, of a motion x (n,) of the joints. */
void r47_tool_twist(const r47_tool_space *space, const double *x, double *product);

/* product (6,) = inertia x. */
void r47_tool_inertia_times(const r47_tool_space *space, const double *x, double *product);

/* The part (n,) of a motion x (n,) that does not move the tool, whose twist is given. */
void r47_tool_null(const r47_tool_space *space, const double *x, const double *twist, double *part);

/* product (6,) = J' x, with the velocities of the last inverse dynamics. */
void r47_tool_rate_times(const r47_tool_space *space, const double *x, double *product);

#endif
