/* Forward kinematics and Jacobians of an open chain or tree of hinges and slides. */
#ifndef ROBO47_CHAIN_H
#define ROBO47_CHAIN_H

enum { R47_MAX_N = 64 }; /* most joints of an arm */

/* A frame is 12 numbers: its rotation matrix row by row, then its origin [m].

   Joint i turns about, or slides along, the z axis of its own frame. `offset` is the frame of
   joint i at q0 in the frame of the joint before it, parent[i] < i; of the first joints, whose
   parent is -1, in the world. */
typedef struct {
  int n;                /* joints */
  const int *parent;    /* (n,) */
  const int *slides;    /* (n,) nonzero for a slide */
  const double *q0;     /* (n,) [rad or m] */
  const double *offset; /* (n, 12) */
  int frames;           /* frames fixed to links: tools first, then others */
  const int *joint;     /* (frames,) the joint that moves each; -1 for the world */
  const double *fixed;  /* (frames, 12) each in the frame of its joint */
} r47_chain;

/* Frames of all joints in the world (n, 12) at q (n,). */
void r47_links(const r47_chain *chain, const double *q, double *links);

/* One of the chain's fixed frames in the world (12,). */
void r47_frame(const r47_chain *chain, const double *links, int frame, double *T);

/* The same at many configurations q (count, n), as homogeneous matrices T (count, 4, 4). */
void r47_frame_many(const r47_chain *chain, int frame, int count, const double *q, double *T);

/* Jacobian (6, n) of a point [m] that moves with a joint: its velocity, then the angular velocity,
   both with the axes of the world. */
void r47_jacobian(const r47_chain *chain, const double *links, int joint, const double *point,
                  double *J);

#endif
