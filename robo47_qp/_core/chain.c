#include "chain.h"

#include "elementary_inline.h"
#include "linear_inline.h"

void r47_links(const r47_chain *chain, const double *q, double *links) {
  for (int i = 0; i < chain->n; i++) {
    double *T = links + 12 * i;
    const double *offset = chain->offset + 12 * i;
    const double moved = q[i] - chain->q0[i];
    if (chain->parent[i] < 0)
      memcpy(T, offset, 12 * sizeof(double));
    else
      compose(links + 12 * chain->parent[i], offset, T);
    if (chain->slides[i]) {
      for (int k = 0; k < 3; k++) T[9 + k] += moved * T[3 * k + 2];
      continue;
    }
    const double c = cos(moved), s = sin(moved);
    for (int k = 0; k < 3; k++) {
      const double x = T[3 * k], y = T[3 * k + 1];
      T[3 * k] = c * x + s * y;
      T[3 * k + 1] = c * y - s * x;
    }
  }
}

void r47_frame(const r47_chain *chain, const double *links, int frame, double *T) {
  const int joint = chain->joint[frame];
  if (joint < 0)
    memcpy(T, chain->fixed + 12 * frame, 12 * sizeof(double));
  else
    compose(links + 12 * joint, chain->fixed + 12 * frame, T);
}

void r47_frame_many(const r47_chain *chain, int frame, int count, const double *q, double *T) {
  double links[12 * R47_MAX_N], own[12];
  for (int i = 0; i < count; i++) {
    double *out = T + 16 * i;
    r47_links(chain, q + i * chain->n, links);
    r47_frame(chain, links, frame, own);
    for (int row = 0; row < 3; row++) {
      memcpy(out + 4 * row, own + 3 * row, 3 * sizeof(double));
      out[4 * row + 3] = own[9 + row];
    }
    out[12] = out[13] = out[14] = 0.0;
    out[15] = 1.0;
  }
}

void r47_jacobian(const r47_chain *chain, const double *links, int joint, const double *point,
                  double *J) {
  const int n = chain->n;
  memset(J, 0, 6 * (size_t)n * sizeof(double));
  for (int i = joint; i >= 0; i = chain->parent[i]) {
    const double *T = links + 12 * i;
    const double axis[3] = {T[2], T[5], T[8]};
    if (chain->slides[i]) {
      for (int k = 0; k < 3; k++) J[k * n + i] = axis[k];
      continue;
    }
    const double arm[3] = {point[0] - T[9], point[1] - T[10], point[2] - T[11]};
    double velocity[3];
    cross3(axis, arm, velocity);
    for (int k = 0; k < 3; k++) {
      J[k * n + i] = velocity[k];
      J[(3 + k) * n + i] = axis[k];
    }
  }
}
