#include "tool_motion.h"

#include "elementary_inline.h"
#include "linear_inline.h"

/* out += k a x b */
static void add_cross(double k, const double *a, const double *b, double *out) {
  double product[3];
  cross3(a, b, product);
  for (int i = 0; i < 3; i++) out[i] += k * product[i];
}

static void add(double k, const double *a, double *out) {
  for (int i = 0; i < 3; i++) out[i] += k * a[i];
}

/* A screw motion by x before the displacement R, p. */
static void move(const double *axis, const double *moment, double x, double *R, double *p) {
  const double K[9] = {0.0, -axis[2], axis[1], axis[2], 0.0, -axis[0], -axis[1], axis[0], 0.0};
  const double s = sin(x), c = 1.0 - cos(x);
  double turn[9], anchor[3], moved[3], shift[3], before[9];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      double square = 0.0;
      for (int l = 0; l < 3; l++) square += K[3 * i + l] * K[3 * l + k];
      turn[3 * i + k] = (i == k ? 1.0 : 0.0) + s * K[3 * i + k] + c * square;
    }
  cross3(axis, moment, anchor);
  rotate3(turn, anchor, moved);
  for (int i = 0; i < 3; i++) anchor[i] -= moved[i];
  rotate3(R, anchor, shift);
  for (int i = 0; i < 3; i++) p[i] += shift[i];
  memcpy(before, R, sizeof before);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      R[3 * i + k] = before[3 * i] * turn[k] + before[3 * i + 1] * turn[3 + k] +
                     before[3 * i + 2] * turn[6 + k];
}

/* The joints' twist (w, u) at the world's origin and its two derivatives, in the order w, u, ... */
static void joint(const double *s, const double *m, double v, double a, double j, double *V) {
  double *w = V, *u = V + 3, *dw = V + 6, *du = V + 9, *ddw = V + 12, *ddu = V + 15;
  double ds[3] = {0.0}, dm[3] = {0.0}, dds[3] = {0.0}, ddm[3] = {0.0};
  add_cross(1.0, w, s, ds);
  add_cross(1.0, u, s, dm);
  add_cross(1.0, w, m, dm);
  add_cross(1.0, dw, s, dds);
  add_cross(1.0, w, ds, dds);
  add_cross(1.0, du, s, ddm);
  add_cross(1.0, dw, m, ddm);
  add_cross(1.0, u, ds, ddm);
  add_cross(1.0, w, dm, ddm);
  add(v, s, w), add(v, m, u);
  add(a, s, dw), add(v, ds, dw);
  add(a, m, du), add(v, dm, du);
  add(j, s, ddw), add(2.0 * a, ds, ddw), add(v, dds, ddw);
  add(j, m, ddu), add(2.0 * a, dm, ddu), add(v, ddm, ddu);
}

static void row_of(const r47_screws *c, const double *q, const double *v, const double *a,
                   const double *j, double *out) {
  double R[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, p[3] = {0.0}, V[18] = {0.0};
  for (int k = 0; k < c->count; k++) {
    const double *axis = c->axis + 3 * k, *moment = c->moment + 3 * k;
    const int i = c->joint[k];
    const double x = q[i] - c->zero[k], still[3] = {0.0};
    double s[3], m[3];
    rotate3(R, axis, s);
    if (c->turns[k]) {
      rotate3(R, moment, m);
      add_cross(1.0, p, s, m);
      joint(s, m, v[i], a[i], j[i], V);
      move(axis, moment, x, R, p);
    } else {
      joint(still, s, v[i], a[i], j[i], V);
      add(x, s, p);
    }
  }
  const double *w = V, *dw = V + 6, *ddw = V + 12;
  double x[3], *dx = out, *ddx = out + 3, *dddx = out + 6;
  rotate3(R, c->point, x);
  add(1.0, p, x);
  memcpy(dx, V + 3, 3 * sizeof(double));
  add_cross(1.0, w, x, dx);
  memcpy(ddx, V + 9, 3 * sizeof(double));
  add_cross(1.0, dw, x, ddx);
  add_cross(1.0, w, dx, ddx);
  memcpy(dddx, V + 15, 3 * sizeof(double));
  add_cross(1.0, ddw, x, dddx);
  add_cross(2.0, dw, dx, dddx);
  add_cross(1.0, w, ddx, dddx);
  memcpy(out + 9, w, 3 * sizeof(double));
  memcpy(out + 12, dw, 3 * sizeof(double));
  memcpy(out + 15, ddw, 3 * sizeof(double));
}

void r47_tool_motion(const r47_screws *screws, int rows, const double *q, const double *v,
                     const double *a, const double *j, double *motion) {
  for (int k = 0; k < rows; k++) {
    const int at = k * screws->n;
    row_of(screws, q + at, v + at, a + at, j + at, motion + 18 * k);
  }
}
