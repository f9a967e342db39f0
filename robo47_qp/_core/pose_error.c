#include "pose_error.h"

#include "elementary_inline.h"
#include "linear_inline.h"

/* Angle in [0, π] of sine s >= 0 and cosine c, by one Newton step on the sphere: a rough one, and
   the arc sine of what it lacks. */
static double angle_of(double s, double c) {
  const double x = fabs(c), t = s < x ? s / x : x / s;
  double rough = t * (0.9724 - 0.1919 * t * t);
  if (s >= x) rough = 0.5 * 3.141592653589793 - rough;
  if (c < 0.0) rough = 3.141592653589793 - rough;
  const double d = s * cos(rough) - c * sin(rough), d2 = d * d;
  return rough + d * (1.0 + d2 * (1.0 / 6.0 + d2 * (3.0 / 40.0 + d2 * (15.0 / 336.0))));
}

void r47_frame_of(const double *wxyz_xyz, double *T) {
  double q[4], length = 0.0;
  for (int i = 0; i < 4; i++) length += wxyz_xyz[i] * wxyz_xyz[i];
  length = sqrt(length);
  for (int i = 0; i < 4; i++) q[i] = wxyz_xyz[i] / length;
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  T[0] = w * w + x * x - y * y - z * z, T[1] = 2.0 * (x * y - w * z), T[2] = 2.0 * (x * z + w * y);
  T[3] = 2.0 * (x * y + w * z), T[4] = w * w - x * x + y * y - z * z, T[5] = 2.0 * (y * z - w * x);
  T[6] = 2.0 * (x * z - w * y), T[7] = 2.0 * (y * z + w * x), T[8] = w * w - x * x - y * y + z * z;
  for (int i = 0; i < 3; i++) T[9 + i] = wxyz_xyz[4 + i];
}

/* Rotation vector of a rotation matrix, by its quaternion, from its largest entry (Shepperd,
   "Quaternion from rotation matrix", 1978): exact near no turn and near half a turn. */
static void rotation_vector(const double *R, double *w) {
  const double trace = R[0] + R[4] + R[8];
  double scalar, v[3];
  if (trace >= R[0] && trace >= R[4] && trace >= R[8]) {
    scalar = 1.0 + trace;
    v[0] = R[7] - R[5], v[1] = R[2] - R[6], v[2] = R[3] - R[1];
  } else {
    const int i = R[0] >= R[4] && R[0] >= R[8] ? 0 : (R[4] >= R[8] ? 1 : 2);
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    scalar = R[3 * k + j] - R[3 * j + k];
    v[i] = 1.0 + R[4 * i] - R[4 * j] - R[4 * k];
    v[j] = R[3 * i + j] + R[3 * j + i];
    v[k] = R[3 * i + k] + R[3 * k + i];
  }
  const double sine = sqrt(dot3(v, v)), length = sqrt(sine * sine + scalar * scalar);
  double per = 0.0;
  if (sine > 0.0) per = 2.0 * angle_of(sine / length, fabs(scalar) / length) / sine;
  if (scalar < 0.0) per = -per;
  for (int i = 0; i < 3; i++) w[i] = per * v[i];
}

void r47_pose_error(const double *T, const double *T_target, double *e) {
  double R[9];
  for (int i = 0; i < 3; i++) {
    e[i] = T_target[9 + i] - T[9 + i];
    for (int j = 0; j < 3; j++) R[3 * i + j] = dot3(T_target + 3 * i, T + 3 * j);
  }
  rotation_vector(R, e + 3);
}

static void skew(const double *a, double *out) {
  out[0] = 0.0, out[1] = -a[2], out[2] = a[1];
  out[3] = a[2], out[4] = 0.0, out[5] = -a[0];
  out[6] = -a[1], out[7] = a[0], out[8] = 0.0;
}

static void multiply(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* With w the rotation vector and p the displacement the twist is (A p, w),
   A = I - ½ [w] + c [w]², c = (1 - (θ/2) cot(θ/2)) / θ², θ = ‖w‖. Its decrease is the inverse of
   the left Jacobian of SE(3), I - ½ ad + c₂ ad² + c₄ ad⁴, c₂ = c + c₄ θ², ad = [[w] [v]; 0 [w]]
   (Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, 2012, ch. 10). The
   even part of the slope is h(θ) = (θ/2) cot(θ/2) on the eigenvalues ±iθ of ad, each double:
   value and derivative give 1 - c₂ θ² + c₄ θ⁴ = h and -2 c₂ θ + 4 c₄ θ³ = h'. */
void r47_pose_log(const double *e, double *twist, double *A, double *B) {
  const double *w = e + 3, x = dot3(w, w);
  double c, c4;
  if (x < 1e-2) {
    c = 1.0 / 12 + x * (1.0 / 720 + x * (1.0 / 30240 + x / 1209600));
    c4 = -1.0 / 720 - x * (2.0 / 30240 + x * (3.0 / 1209600 + x * 4 / 47900160));
  } else {
    const double angle = sqrt(x), cot = cos(0.5 * angle) / sin(0.5 * angle);
    c = (1.0 - 0.5 * angle * cot) / x;
    c4 = (0.5 * cot - 0.25 * angle * (1.0 + cot * cot) + 2.0 * angle * c) / (2.0 * x * angle);
  }
  const double c2 = c + c4 * x;
  double W[9], V[9], WW[9], WV[9], VW[9], U[9], WWU[9], UWW[9];
  skew(w, W);
  multiply(W, W, WW);
  for (int i = 0; i < 9; i++) A[i] = (i % 4 == 0) - 0.5 * W[i] + c * WW[i];
  rotate3(A, e, twist);
  for (int i = 0; i < 3; i++) twist[3 + i] = w[i];
  skew(twist, V);
  multiply(W, V, WV);
  multiply(V, W, VW);
  for (int i = 0; i < 9; i++) U[i] = WV[i] + VW[i];
  multiply(WW, U, WWU);
  multiply(U, WW, UWW);
  for (int i = 0; i < 9; i++) B[i] = -0.5 * V[i] + c2 * U[i] + c4 * (WWU[i] + UWW[i]);
}
