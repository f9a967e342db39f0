#include "velocity_box.h"

#include "elementary_inline.h"

/* See max_stoppable_speed in joint_bounds.py, with the step a_max dt. */
static double fastest(double distance, double v, double step, double dt) {
  const double delta = (distance / dt - 0.5 * v) / step;
  if (delta <= 0.0) return 0.0;
  const double whole = whole_part(sqrt(2.0 * delta + 0.25) - 0.5);
  return step * (0.5 * whole + delta / (whole + 1.0));
}

int r47_velocity_box(int n, const double *limits, double dt, double rounding, const double *q,
                     const double *v, double *low, double *high) {
  for (int j = 0; j < n; j++, limits += 5) {
    const double above = limits[1] - q[j], below = q[j] - limits[0], step = limits[3];
    const double slowest = v[j] - step, quickest = v[j] + step;
    double most = limits[2], down = -limits[2];
    if (above < limits[4]) most = least(most, fastest(above, v[j], step, dt));
    if (below < limits[4]) down = largest(down, -fastest(below, -v[j], step, dt));
    if (least(least(above, below), least(most - slowest, quickest - down)) < -rounding) return 1;
    high[j] = least(largest(most, slowest), quickest);
    low[j] = least(least(largest(down, slowest), quickest), high[j]);
  }
  return 0;
}
