#include "clearance.h"

#include "crossing_inline.h"
#include "elementary_inline.h"
#include "linear_inline.h"

typedef double (*geom_distance)(const void *model, void *data, int first, int second, double most,
                                double *segment);

/* Puts the first `count` numbers of `items` in the order of key[item]; equal ones stay in theirs.
 */
static void sort(const double *key, long long *items, long long *memory, int count) {
  for (int width = 1; width < count; width *= 2) {
    for (int low = 0; low < count; low += 2 * width) {
      const int middle = low + width < count ? low + width : count;
      const int high = low + 2 * width < count ? low + 2 * width : count;
      for (int i = low, j = middle, k = low; k < high; k++) {
        const int left = i < middle && (j >= high || key[items[i]] <= key[items[j]]);
        memory[k] = left ? items[i++] : items[j++];
      }
    }
    memcpy(items, memory, (size_t)count * sizeof(long long));
  }
}

static int measure(r47_clearance *c) {
  int doubtful = 0;
  c->picked = c->urgent < c->most ? c->urgent : c->most;
  for (int k = 0; k < c->picked; k++) {
    const int i = (int)c->pair[k];
    c->apart[k] = ((geom_distance)c->distance)(c->model, c->data, c->first[i], c->second[i],
                                               c->within[k] + c->ahead, c->segment + 6 * k);
    /* What cannot overlap is sure. */
    c->doubtful[k] = c->bound[i] <= 0.0 && c->capsule[i] >= 0 &&
                     may_cross(c->xpos, c->xmat, c->size, c->capsule[i], c->box[i]);
    doubtful += c->doubtful[k];
  }
  return doubtful;
}

/* Trusts no row any more that has not been renewed since the last call. */
static void age(r47_clearance *c) {
  for (int i = 0; i < c->pairs; i++) {
    if (!c->looked[i]) c->unseen[i] = 1;
    c->looked[i] = 0;
  }
  c->travel = 0.0;
}

int r47_clearance_reset(r47_clearance *c, const double *q) {
  memcpy(c->q, q, (size_t)c->n * sizeof(double));
  c->travel = 0.0;
  const int most = c->most;
  c->most = c->urgent = c->pairs;
  for (int i = 0; i < c->pairs; i++) {
    c->pair[i] = i;
    c->bound[i] = -INFINITY;
    c->within[i] = c->far - c->ahead;
  }
  const int doubtful = measure(c);
  c->most = most;
  return doubtful;
}

int r47_clearance_look(r47_clearance *c, const double *q, const double *v) {
  const int n = c->n;
  double step[R47_MAX_N], moved[R47_MAX_N], speed[R47_MAX_N], way[R47_MAX_N];
  for (int j = 0; j < n; j++) {
    step[j] = q[j] - c->q[j];
    c->q[j] = q[j];
    moved[j] = fabs(step[j]);
    c->travel += moved[j];
    speed[j] = fabs(v[j]) + c->a[j] * c->dt;
    way[j] = (speed[j] / (2.0 * c->a[j]) + c->dt) * speed[j];
  }
  double *needed = c->key;
  const int old = c->travel > 0.5 * c->trusted;
  for (int i = 0; i < c->pairs; i++) {
    const double *L = c->L + (size_t)i * n, *A = c->A + (size_t)i * n;
    double sunk = 0.0, closing = 0.0, unknown = 0.0, sunk_by = 0.0, closing_by = 0.0;
    for (int j = 0; j < n; j++) {
      sunk += moved[j] * L[j];
      closing += speed[j] * L[j];
      unknown += way[j] * L[j];
      sunk_by += step[j] * A[j];
      closing_by += v[j] * A[j];
    }
    /* Where a pair's row is known, these bounds are on its error. */
    const double part = c->unseen[i] ? 1.0 : c->unsure;
    c->bound[i] -= part * sunk + largest(sunk_by, 0.0);
    closing = part * closing + largest(closing_by, 0.0);
    needed[i] = (0.5 * closing / c->brake[i] + c->dt) * closing;
    if (c->unseen[i] || (old && !c->looked[i])) needed[i] = part * unknown;
    needed[i] = largest(needed[i], c->near) + c->d_min;
  }
  if (old) age(c);
  c->urgent = 0;
  for (int i = 0; i < c->pairs; i++)
    if (c->bound[i] < needed[i]) {
      c->within[i] = needed[i];
      c->pair[c->urgent++] = i;
    }
  if (c->urgent > c->most) {
    for (int k = 0; k < c->urgent; k++) {
      const long long i = c->pair[k];
      c->key[i] = (c->bound[i] - c->d_min) / (c->within[i] - c->d_min);
    }
    sort(c->key, c->pair, c->order, c->urgent);
  }
  /* From by pair to by urgency; each is read before it may be overwritten. */
  for (int k = 0; k < c->urgent; k++) c->key[k] = c->within[c->pair[k]];
  memcpy(c->within, c->key, (size_t)c->urgent * sizeof(double));
  return measure(c);
}

/* The row of a pair, from its nearest points: n . (v + w x (p - c)) per joint with the twist
   (w, v) about c, n from the first to the second geom; and how hard it can brake. */
static void renew(r47_clearance *c, int i, double apart, const double *segment) {
  const int n = c->n;
  double normal[3], stop = 0.0, *A = c->A + (size_t)i * n;
  for (int k = 0; k < 3; k++) normal[k] = (segment[3 + k] - segment[k]) / apart;
  for (int j = 0; j < n; j++) {
    const double *twist = c->cdof + 6 * j, *centre = c->com + 3 * c->root[j];
    const double sign = c->sign[(size_t)i * n + j];
    A[j] = 0.0;
    if (sign == 0.0) continue;
    const double from[3] = {segment[0] - centre[0], segment[1] - centre[1], segment[2] - centre[2]};
    double turned[3];
    cross3(twist, from, turned);
    A[j] = sign * (dot3(normal, twist + 3) + dot3(normal, turned));
    stop += fabs(A[j]) * c->a[j];
  }
  c->stop[i] = largest(stop, c->least);
  c->brake[i] = largest(stop, c->least_brake[i]);
}

void r47_clearance_take(r47_clearance *c) {
  c->measured = INFINITY;
  for (int k = 0; k < c->picked; k++) {
    const int i = (int)c->pair[k];
    const double apart = c->apart[k], most = c->within[k] + c->ahead;
    c->measured = least(c->measured, apart);
    c->bound[i] = least(apart, most);
    c->looked[i] = 1;
    c->unseen[i] = !(apart < most);
    if (c->unseen[i]) {
      memset(c->A + (size_t)i * c->n, 0, (size_t)c->n * sizeof(double));
      c->stop[i] = c->least;
    } else if (fabs(apart) > c->touch) {
      /* Nearest points that touch show no direction: such a pair keeps its last row. */
      renew(c, i, apart, c->segment + 6 * k);
    }
  }
}

/* See max_stoppable_speed in joint_bounds.py. */
static double stoppable(double distance, double v, double a, double dt) {
  const double step = a * dt, delta = largest((distance / dt - 0.5 * v) / step, 0.0);
  const double whole = whole_part(sqrt(2.0 * delta + 0.25) - 0.5);
  return step * (0.5 * whole + delta / (whole + 1.0));
}

int r47_clearance_rows(r47_clearance *c, const double *v) {
  const int n = c->n;
  int active = 0;
  double *upper = c->apart, *room = c->segment; /* what was measured is taken in */
  for (int k = 0; k < c->urgent; k++) {
    const long long i = c->pair[k];
    if (!(c->bound[i] < c->within[k])) continue;
    const double *A = c->A + (size_t)i * n;
    double closing = 0.0;
    for (int j = 0; j < n; j++) closing += A[j] * v[j];
    room[active] = c->bound[i] - c->d_min;
    const double lacking = -room[active];
    if (lacking > 0.0)
      upper[active] =
          -least(c->parting * stoppable(lacking, 0.0, c->stop[i], c->dt), c->regain * lacking);
    else
      upper[active] = stoppable(room[active], closing, c->stop[i], c->dt);
    c->key[active] = upper[active] - closing;
    c->other[active] = active;
    c->pair[active++] = i;
  }
  if (active > c->most) {
    sort(c->key, c->other, c->order, active);
    active = c->most;
  }
  for (int k = 0; k < active; k++) {
    const long long at = c->other[k], i = c->pair[at];
    c->row_pair[k] = i;
    c->row_upper[k] = upper[at];
    c->row_room[k] = room[at];
    memcpy(c->row_A + (size_t)k * n, c->A + (size_t)i * n, (size_t)n * sizeof(double));
  }
  return active;
}
