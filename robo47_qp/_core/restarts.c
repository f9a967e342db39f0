#include "restarts.h"

#include "elementary_inline.h"
#include "pose_error.h"

enum { N = R47_MAX_N, MOST_CLOSE = 128, MOST_ENDS = 8 };

/* Where the next start comes from. */
typedef struct {
  const r47_library *library;
  float *distance; /* of those not taken yet; infinite for the others */
  int measured;    /* nonzero once `distance` is filled */
  int near;        /* starts by nearness that are left */
  int seed;        /* nonzero while the seed is to come */
  int rest;        /* the others in their order go on here */
} starts;

/* Ends close to the target since the last look at them. */
typedef struct {
  int count;
  double error[MOST_CLOSE];
  double q[MOST_CLOSE][N];
} close_ends;

static void feature_of(const r47_library *library, const double *T, float *feature) {
  for (int i = 0; i < 3; i++) feature[i] = (float)T[9 + i];
  for (int i = 3; i < library->features; i++) feature[i] = (float)(T[i - 3] * library->turn);
}

void r47_library_distances(const r47_library *library, const double *T, float *distance) {
  const int count = library->count;
  float target[12];
  feature_of(library, T, target);
  memcpy(distance, library->half_square, (size_t)count * sizeof(float));
  for (int i = 0; i < library->features; i++) {
    const float *column = library->feature + i * count, t = target[i];
    for (int k = 0; k < count; k++) distance[k] -= column[k] * t;
  }
}

/* Place of the least number, the first of equal ones; it is infinite from now on. */
static int take_nearest(int count, float *distance) {
  /* The least of every eighth number, then the first that is as small: no branch a number. */
  float lane[8], smallest = (float)INFINITY;
  for (int i = 0; i < 8; i++) lane[i] = (float)INFINITY;
  int k = 0, place = 0;
  for (; k + 8 <= count; k += 8)
    for (int i = 0; i < 8; i++) lane[i] = distance[k + i] < lane[i] ? distance[k + i] : lane[i];
  for (int i = 0; i < 8; i++) smallest = lane[i] < smallest ? lane[i] : smallest;
  for (; k < count; k++) smallest = distance[k] < smallest ? distance[k] : smallest;
  while (place < count - 1 && distance[place] != smallest) place++;
  distance[place] = (float)INFINITY;
  return place;
}

static int seed_is_nearer(const r47_restarts *r, const double *T_target, const double *q_seed,
                          float nearest) {
  double links[12 * N], T[12];
  float seed[12], target[12], distance = 0.0f;
  r47_links(r->descent->chain, q_seed, links);
  r47_frame(r->descent->chain, links, r->descent->tool[0], T);
  feature_of(r->library, T, seed);
  feature_of(r->library, T_target, target);
  for (int i = 0; i < r->library->features; i++) distance += seed[i] * (0.5f * seed[i] - target[i]);
  return distance <= nearest;
}

/* Copy the next start to q (n,); 0 where there is none left. */
static int next_start(const r47_restarts *r, starts *s, const double *T_target,
                      const double *q_seed, double *q) {
  const int count = r->library->count;
  const size_t bytes = (size_t)r->descent->chain->n * sizeof(double);
  if (s->seed && r->seed_first) {
    s->seed = 0;
    memcpy(q, q_seed, bytes);
    return 1;
  }
  if (!s->measured) {
    r47_library_distances(r->library, T_target, s->distance);
    s->measured = 1;
  }
  int place;
  if (s->seed) {
    int nearest = 0;
    for (int k = 1; k < count; k++)
      if (s->distance[k] < s->distance[nearest]) nearest = k;
    s->seed = 0;
    if (seed_is_nearer(r, T_target, q_seed, s->distance[nearest])) {
      memcpy(q, q_seed, bytes);
      return 1;
    }
  }
  if (s->near > 0) {
    s->near--;
    place = take_nearest(count, s->distance);
  } else {
    while (s->rest < count && s->distance[s->rest] == (float)INFINITY) s->rest++;
    if (s->rest == count) return 0;
    place = s->rest++;
  }
  memcpy(q, r->library->q + place * r->descent->chain->n, bytes);
  for (int k = 0; k < r->stills; k++) q[r->still[k]] = q_seed[r->still[k]];
  return 1;
}

/* Count a descent, and keep its end if it is close; nonzero where it reached the target. */
static int take(const r47_restarts *r, const r47_end *end, const double *q, close_ends *ends,
                double *answer) {
  const double error = sqrt(end->distance2) + sqrt(end->angle2);
  answer[R47_ITERATIONS] += end->iterations;
  answer[R47_DESCENTS] += 1.0;
  if (end->reached) answer[R47_FOUND] = 1.0;
  if (end->reached || ends->count == MOST_CLOSE) return end->reached;
  if (error < r->close) {
    ends->error[ends->count] = error;
    memcpy(ends->q[ends->count++], q, (size_t)r->descent->chain->n * sizeof(double));
  }
  return 0;
}

static int alike(int n, double same, const double *a, const double *b) {
  for (int i = 0; i < n; i++)
    if (fabs(a[i] - b[i]) > same) return 0;
  return 1;
}

/* Move the closest ends that differ to q (MOST_ENDS, n), the closest first, and forget all. */
static int closest(const r47_restarts *r, close_ends *ends, double q[MOST_ENDS][N]) {
  const int n = r->descent->chain->n;
  int found = 0;
  while (found < r->ends) {
    int best = -1;
    for (int k = 0; k < ends->count; k++)
      if (ends->error[k] < INFINITY && (best < 0 || ends->error[k] < ends->error[best])) best = k;
    if (best < 0) break;
    ends->error[best] = INFINITY;
    int known = 0;
    for (int k = 0; k < found; k++) known |= alike(n, r->same, q[k], ends->q[best]);
    if (!known) memcpy(q[found++], ends->q[best], (size_t)n * sizeof(double));
  }
  ends->count = 0;
  return found;
}

/* Continue the closest ends by the thorough descent; nonzero where one reached the target. */
static int look_again(const r47_restarts *r, close_ends *ends, const double *target, double *q,
                      double *answer) {
  double again[MOST_ENDS][N];
  const int count = closest(r, ends, again);
  for (int k = 0; k < count; k++) {
    r47_end end;
    memcpy(q, again[k], (size_t)r->descent->chain->n * sizeof(double));
    r47_descend(r->thorough, target, again[k], q, &end);
    if (take(r, &end, q, ends, answer)) return 1;
  }
  return 0;
}

static void solve(const r47_restarts *r, const double *target, const double *q_seed,
                  float *distance, double *q, double *answer) {
  double T_target[12], start[N];
  starts from = {.library = r->library, .distance = distance, .near = r->near, .seed = 1};
  close_ends ends;
  ends.count = 0;
  memset(answer, 0, R47_ANSWER * sizeof(double));
  r47_frame_of(target, T_target);
  int look = 0;
  for (int k = 0; k < r->starts && next_start(r, &from, T_target, q_seed, start); k++) {
    r47_end end;
    memcpy(q, start, (size_t)r->descent->chain->n * sizeof(double));
    r47_descend(r->descent, target, start, q, &end);
    if (take(r, &end, q, &ends, answer)) return;
    if (look < r->looks && k + 1 == r->look[look]) {
      if (look_again(r, &ends, target, q, answer)) return;
      look++;
    }
  }
}

void r47_solve_many(const r47_restarts *r, int count, const double *targets, const double *q_seeds,
                    float *scratch, double *q, double *answers) {
  const int n = r->descent->chain->n;
  for (int i = 0; i < count; i++)
    solve(r, targets + 7 * i, q_seeds + i * n, scratch, q + i * n, answers + R47_ANSWER * i);
}
