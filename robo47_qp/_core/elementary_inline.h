/* What the compiler itself brings: the core is built without a C library. */
#ifndef ROBO47_ELEMENTARY_INLINE_H
#define ROBO47_ELEMENTARY_INLINE_H

#include <stddef.h>

double sin(double x);
double cos(double x);
double sqrt(double x);
double fabs(double x);
void *memcpy(void *to, const void *from, size_t bytes);
void *memset(void *to, int byte, size_t bytes);

#define INFINITY __builtin_inf()

static inline double least(double a, double b) {
  return a < b ? a : b;
}

static inline double largest(double a, double b) {
  return a > b ? a : b;
}

/* A number of 0 or more without its fraction; from 2^52 on it has none. */
static inline double whole_part(double x) {
  return x < 4503599627370496.0 ? (double)(long long)x : x;
}

/* What is no number stays so. */
static inline double clipped(double x, double low, double high) {
  x = x < low ? low : x;
  return x > high ? high : x;
}

#endif
