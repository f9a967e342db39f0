#include "approach.h"

#include "crossing_inline.h"
#include "elementary_inline.h"

typedef void (*kinematics)(const void *model, void *data);
typedef double (*geom_distance)(const void *model, void *data, int first, int second, double most,
                                double *segment);

static void place(const r47_approach *a, const double *q) {
  for (int i = 0; i < a->joints; i++) a->qpos[a->address[i]] = q[i];
  ((kinematics)a->kinematics)(a->model, a->data);
}

static double measured(const r47_approach *a, int pair, double seen, int *doubtful) {
  double segment[6];
  const double most = seen < a->far ? seen : a->far;
  const double found = ((geom_distance)a->distance)(a->model, a->data, a->first[pair],
                                                    a->second[pair], most, segment);
  const int capsule = a->capsule[pair];
  *doubtful = capsule >= 0 && may_cross(a->xpos, a->xmat, a->size, capsule, a->box[pair]);
  return found >= most ? seen : found;
}

/* Whether the bounding sphere of a geom is further than `seen` from the bounding box of another. */
static int beyond(const r47_approach *a, int sphere, int box, double seen) {
  const double *R = a->xmat + 9 * box, *aabb = a->aabb + 6 * box;
  const double least = seen + a->rbound[sphere];
  double between[3], square = 0.0;
  for (int i = 0; i < 3; i++) between[i] = a->xpos[3 * sphere + i] - a->xpos[3 * box + i];
  for (int i = 0; i < 3; i++) {
    const double along = R[i] * between[0] + R[3 + i] * between[1] + R[6 + i] * between[2];
    const double out = fabs(along - aabb[i]) - aabb[3 + i];
    if (out > 0.0) square += out * out;
  }
  return square > least * least;
}

static int far_apart(const r47_approach *a, int pair, double seen) {
  const int one = a->first[pair], other = a->second[pair];
  if (a->rbound[one] == 0.0 || a->rbound[other] == 0.0) return 0;
  return beyond(a, one, other, seen) || beyond(a, other, one, seen);
}

void r47_approach_at(const r47_approach *a, const double *q, double seen, double *distance,
                     unsigned char *doubtful) {
  place(a, q);
  for (int i = 0; i < a->pairs; i++) {
    int unsure = 0;
    distance[i] = far_apart(a, i, seen) ? seen : measured(a, i, seen, &unsure);
    doubtful[i] = (unsigned char)unsure;
  }
}

/* By how much the pair can have come closer from the first row to this one. */
static double closed(const r47_approach *a, const r47_path *p, int row, int pair) {
  const double *travelled = p->travelled + (size_t)row * (size_t)a->joints;
  const double *reach = a->reach + (size_t)pair * (size_t)a->joints;
  double sum = 0.0;
  for (int i = 0; i < a->joints; i++) sum += travelled[i] * reach[i];
  return sum;
}

/* The first row in which the pair can have closed by more than `far`. */
static int first_beyond(const r47_approach *a, const r47_path *p, int pair, double far) {
  int low = 0, high = p->rows;
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (closed(a, p, middle, pair) > far)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

static void take(r47_path *p, int pair) {
  if (p->distance < p->best) {
    p->best = p->distance;
    p->best_row = p->row;
    p->best_pair = pair;
  }
}

int r47_approach_along(const r47_approach *a, r47_path *p) {
  if (p->asked) {
    p->asked = 0;
    take(p, p->order[p->next]);
  }
  for (; p->next < a->pairs; p->next++, p->row = -1) {
    const int pair = p->order[p->next];
    if (p->row < 0) {
      p->row = 0;
      p->distance = p->start[pair];
    }
    for (;;) {
      const double far = closed(a, p, p->row, pair) + p->distance - p->best + p->resolution;
      const int next = first_beyond(a, p, pair, far);
      p->row = next > p->row ? next : p->row + 1;
      if (p->row >= p->rows) break;
      place(a, p->q + (size_t)p->row * (size_t)a->joints);
      int unsure;
      p->distance = measured(a, pair, INFINITY, &unsure);
      if (unsure) {
        p->asked = 1;
        return 1;
      }
      take(p, pair);
    }
  }
  return 0;
}
