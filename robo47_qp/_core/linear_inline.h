/* Vectors of three numbers, and rotations as nine numbers row by row. */
#ifndef ROBO47_LINEAR_INLINE_H
#define ROBO47_LINEAR_INLINE_H

static inline double dot3(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross3(const double *a, const double *b, double *out) {
  const double x = a[1] * b[2] - a[2] * b[1];
  const double y = a[2] * b[0] - a[0] * b[2];
  const double z = a[0] * b[1] - a[1] * b[0];
  out[0] = x, out[1] = y, out[2] = z;
}

/* out = R a; out may not be a. */
static inline void rotate3(const double *R, const double *a, double *out) {
  for (int i = 0; i < 3; i++) out[i] = dot3(R + 3 * i, a);
}

/* out = A B of frames of 12 numbers; out may be neither. */
static inline void compose(const double *A, const double *B, double *out) {
  for (int i = 0; i < 3; i++) {
    const double *a = A + 3 * i;
    for (int j = 0; j < 3; j++) out[3 * i + j] = a[0] * B[j] + a[1] * B[3 + j] + a[2] * B[6 + j];
    out[9 + i] = A[9 + i] + dot3(a, B + 9);
  }
}

#endif
