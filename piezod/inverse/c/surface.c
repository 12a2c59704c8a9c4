/* ---- hysteresis: a surface of loops, on a memory of voltages ---- */

#define INVERSE_STEPS 60 /* most steps of a search */
#ifdef INVERSE_FLOAT
#define INVERSE_SAME R(1e-7)
#else
#define INVERSE_SAME R(1e-14)
#endif

static real inverse_abs(real x) { return x < R(0) ? -x : x; }
static real inverse_most(real a, real b) { return a > b ? a : b; }
#if defined INVERSE_LAG || defined INVERSE_PATH
static real inverse_least(real a, real b) { return a < b ? a : b; }
#endif

typedef struct {
  real move, rising, falling; /* displacement, slope of the rising and of the falling branch */
} inverse_branch;

/* The displacement between two drives, and the slopes at its ends. */
static inverse_branch inverse_surface(real upper, real lower) {
  const real width = inverse_most(upper - lower, R(0)), root = inverse_root(width);
  const real x = R(2) * root - R(1), y = upper + lower - R(1);
  const real q2 = R(1.5) * y * y - R(0.5), q3 = (R(5) * y * q2 - R(2) * y) / R(3);
  const real e2 = R(3) * y, e3 = R(7.5) * y * y - R(1.5);
  real p[6], d[6], value = R(0), common = R(0), skew = R(0);
  inverse_branch branch;
  int i;
  p[0] = R(1);
  p[1] = x;
  p[2] = R(1.5) * x * x - R(0.5);
  p[3] = (R(5) * x * p[2] - R(2) * x) / R(3);
  p[4] = (R(7) * x * p[3] - R(3) * p[2]) / R(4);
  p[5] = (R(9) * x * p[4] - R(4) * p[3]) / R(5);
  d[0] = R(0);
  d[1] = R(1);
  d[2] = R(3) * x;
  d[3] = R(5) * p[2] + R(1);
  d[4] = R(7) * p[3] + d[2];
  d[5] = R(9) * p[4] + d[3];
  for (i = 0; i < 6; i++) {
    const real *c = inverse_coefficient + 4 * i;
    real level = c[0] + c[1] * y + c[2] * q2 + c[3] * q3;
    value += p[i] * level;
    common += (p[i] + root * d[i]) * level;
    skew += p[i] * (c[1] + c[2] * e2 + c[3] * e3);
  }
  branch.move = width * value;
  branch.rising = common + width * skew;
  branch.falling = common - width * skew;
  return branch;
}

/* ---- the lag of the hysteresis behind its drive ---- */

#ifdef INVERSE_LAG
static real inverse_asinh(real x) {
  real a = inverse_abs(x);
  real value = inverse_log1(a + a * a / (R(1) + inverse_root(R(1) + a * a)));
  return x < R(0) ? -value : value;
}

static real inverse_sinh(real x) {
  real e, q = x * x;
  if (x < R(0.5))
    return x * (R(1) + q / R(6) * (R(1) + q / R(20) * (R(1) + q / R(42) * (R(1) + q / R(72) *
           (R(1) + q / R(110) * (R(1) + q / R(156)))))));
  e = inverse_exp(x);
  return R(0.5) * (e - R(1) / e);
}

static real inverse_cosh(real x) {
  real e = inverse_exp(x);
  return R(0.5) * (e + R(1) / e);
}

/* The drive minus the lagging drive z, and its slope over z. */
static real inverse_behind(const inverse_state *s, real z) {
  return INVERSE_LAG * inverse_asinh((z - s->last) / INVERSE_ADVANCE);
}

static real inverse_behind_slope(const inverse_state *s, real z) {
  real moved = z - s->last;
  return INVERSE_LAG / inverse_root(moved * moved + INVERSE_ADVANCE * INVERSE_ADVANCE);
}

static real inverse_lagging(const inverse_state *s, real drive) {
  const real move = inverse_abs(drive - s->last);
  real a = inverse_least(move / INVERSE_LAG, inverse_asinh(move / INVERSE_ADVANCE)), moved;
  int i;
  for (i = 0; i < 20; i++) {
    real miss = INVERSE_ADVANCE * inverse_sinh(a) + INVERSE_LAG * a - move;
    real step = miss / (INVERSE_ADVANCE * inverse_cosh(a) + INVERSE_LAG);
    a -= step;
    if (inverse_abs(step) <= R(0.1) * INVERSE_SAME * a) break;
  }
  moved = inverse_least(INVERSE_ADVANCE * inverse_sinh(a), move);
  return drive > s->last ? s->last + moved : s->last - moved;
}
#else
#define INVERSE_PROMPT R(0)
static real inverse_behind(const inverse_state *s, real z) { return (void)s, (void)z, R(0); }
static real inverse_behind_slope(const inverse_state *s, real z) { return (void)s, (void)z, R(0); }
static real inverse_lagging(const inverse_state *s, real drive) { return (void)s, drive; }
#endif

/* ---- the part that relaxes along the path of the drive ---- */

#ifdef INVERSE_PATH
#define INVERSE_BACKLASH R(1e-4)

#ifdef INVERSE_EXPONENT
/* dh/dz on a rise: a small h relaxes less. */
static real inverse_rise_slope(real h) {
  const real part = INVERSE_FAST * inverse_abs(h);
  if (!(part > R(0))) return R(1);
  h *= h >= R(0) ? INVERSE_FAST : INVERSE_SLOW;
  return R(1) - h * inverse_power(part, INVERSE_EXPONENT - R(1));
}

/* One step of the method of Runge and Kutta. */
static real inverse_stepped(real h, real step) {
  const real a = inverse_rise_slope(h), b = inverse_rise_slope(h + R(0.5) * step * a);
  const real c = inverse_rise_slope(h + R(0.5) * step * b), d = inverse_rise_slope(h + step * c);
  return h + step * (a + R(2) * b + R(2) * c + d) / R(6);
}

/* Whole steps, then the rest: so h is a continuous function of the rise. */
static real inverse_risen(real h, real rise) {
  const real step = R(1) / (R(16) * inverse_most(INVERSE_FAST, INVERSE_SLOW));
  const int whole = (int)(rise / step);
  int i;
  for (i = 0; i < whole; i++) h = inverse_stepped(h, step);
  return inverse_stepped(h, rise - (real)whole * step);
}
#else
static real inverse_rise_slope(real h) {
  return R(1) - h * (h >= R(0) ? INVERSE_FAST : INVERSE_SLOW);
}

static real inverse_risen(real h, real rise) {
  if (h < R(0)) {
    real to_zero = inverse_log1(-h * INVERSE_SLOW) / INVERSE_SLOW;
    if (rise <= to_zero)
      return R(1) / INVERSE_SLOW + (h - R(1) / INVERSE_SLOW) * inverse_exp(-INVERSE_SLOW * rise);
    rise -= to_zero;
    h = R(0);
  }
  return R(1) / INVERSE_FAST + (h - R(1) / INVERSE_FAST) * inverse_exp(-INVERSE_FAST * rise);
}
#endif

static real inverse_path(const inverse_state *s, real drive, real *slope) {
  const real move = drive - s->pinned, sign = move > R(0) ? R(1) : R(-1);
  real h;
  *slope = R(0);
  if (inverse_abs(move) <= INVERSE_BACKLASH) return s->change;
  h = inverse_risen(sign * (s->change + INVERSE_AT_REST), inverse_abs(move) - INVERSE_BACKLASH);
  *slope = inverse_rise_slope(h);
  return sign * h - INVERSE_AT_REST;
}

static void inverse_advance_path(inverse_state *s, real drive) {
  real slope;
  s->change = inverse_path(s, drive, &slope);
  s->pinned = inverse_most(s->pinned, drive - INVERSE_BACKLASH);
  s->pinned = inverse_least(s->pinned, drive + INVERSE_BACKLASH);
}
#else
#define INVERSE_PATH R(0)
static real inverse_path(const inverse_state *s, real drive, real *slope) {
  (void)s;
  (void)drive;
  *slope = R(0);
  return R(0);
}
static void inverse_advance_path(inverse_state *s, real drive) { (void)s, (void)drive; }
#endif

/* ---- steps and the search for a drive ---- */

static void inverse_store(inverse_state *s, int side) {
  s->value[side][s->count[side]][0] = s->now;
  s->level[side][s->count[side]++] = s->last;
}

static real inverse_beside(const inverse_state *s, real z, real *slope) {
  real relaxing, change = inverse_path(s, z, &relaxing);
  *slope = INVERSE_PROMPT * inverse_behind_slope(s, z) + INVERSE_PATH * relaxing;
  return INVERSE_PROMPT * inverse_behind(s, z) + INVERSE_PATH * change;
}

static void inverse_see(inverse_state *s, real seen) {
  int start;
  inverse_locate(s, seen);
  if (s->rising) {
    start = s->count[INVERSE_BOTTOM] - 1;
    s->now = s->value[INVERSE_BOTTOM][start][0] +
             inverse_surface(seen, s->level[INVERSE_BOTTOM][start]).move;
  } else {
    start = s->count[INVERSE_TOP] - 1;
    s->now = s->value[INVERSE_TOP][start][0] -
             inverse_surface(s->level[INVERSE_TOP][start], seen).move;
  }
  inverse_commit(s, seen);
}

static void inverse_advance(inverse_state *s, real drive) {
  real seen;
  s->raw = inverse_clamp(drive, s->raw);
  seen = inverse_lagging(s, s->raw);
  inverse_see(s, seen);
  inverse_advance_path(s, seen);
}

static real inverse_beside_now(const inverse_state *s) {
  return INVERSE_PROMPT * (s->raw - s->last) + INVERSE_PATH * s->change;
}

static real inverse_at(const inverse_state *s, int side, int place) {
  real slope;
  return s->value[side][place][0] + inverse_beside(s, s->level[side][place], &slope);
}

/* The end of a branch, by Newton's method, or by bisection where a step would leave the bracket. */
static real inverse_solve(const inverse_state *s, real start, real rise, real low, real high,
                          real guess) {
  const int rising = start <= low;
  real drive = low < guess && guess < high ? guess : R(0.5) * (low + high);
  int i;
  for (i = 0; i < INVERSE_STEPS; i++) {
    real slope, miss, beside = inverse_beside(s, drive, &slope);
    inverse_branch branch = rising ? inverse_surface(drive, start) : inverse_surface(start, drive);
    miss = rising ? branch.move + beside - rise : rise - branch.move + beside;
    if (inverse_abs(miss) < INVERSE_SAME) break;
    if (miss > R(0))
      high = drive;
    else
      low = drive;
    drive -= miss / ((rising ? branch.rising : branch.falling) + slope);
    if (!(low < drive && drive < high)) drive = R(0.5) * (low + high);
  }
  return drive;
}

static real inverse_lagging_for(const inverse_state *s, real position) {
  const real now = s->now + INVERSE_PATH * s->change, last = s->last;
  const real guess = last + position - s->now - inverse_beside_now(s);
  int top = s->count[INVERSE_TOP], bottom = s->count[INVERSE_BOTTOM], inside;
  real start = last, at_start = s->now, low = last, high = last;
  if (position > now) {
    inside = !s->rising; /* the last drive would become a minimum */
    bottom += inside;
    while (top > 1 && position >= inverse_at(s, INVERSE_TOP, top - 1)) {
      low = s->level[INVERSE_TOP][--top];
      bottom--;
    }
    high = s->level[INVERSE_TOP][top - 1];
    if (position >= inverse_at(s, INVERSE_TOP, top - 1)) return high;
    if (!inside || bottom <= s->count[INVERSE_BOTTOM]) {
      start = s->level[INVERSE_BOTTOM][bottom - 1];
      at_start = s->value[INVERSE_BOTTOM][bottom - 1][0];
    }
    return inverse_solve(s, start, position - at_start, low, high, guess);
  }
  if (position < now) {
    inside = s->rising; /* the last drive would become a maximum */
    top += inside;
    while (bottom > 1 && position <= inverse_at(s, INVERSE_BOTTOM, bottom - 1)) {
      high = s->level[INVERSE_BOTTOM][--bottom];
      top--;
    }
    low = s->level[INVERSE_BOTTOM][bottom - 1];
    if (position <= inverse_at(s, INVERSE_BOTTOM, bottom - 1)) return low;
    if (!inside || top <= s->count[INVERSE_TOP]) {
      start = s->level[INVERSE_TOP][top - 1];
      at_start = s->value[INVERSE_TOP][top - 1][0];
    }
    return inverse_solve(s, start, at_start - position, low, high, guess);
  }
  return last;
}

void inverse_reset(inverse_state *s) {
  int i;
  inverse_relax(s);
  s->value[INVERSE_TOP][0][0] = inverse_surface(R(1), R(0)).move;
  for (i = 0; i < INVERSE_TURNS; i++) inverse_see(s, inverse_start[i]);
  s->pinned = INVERSE_START_PINNED;
  s->change = INVERSE_START_CHANGE;
  s->raw = s->next = INVERSE_START_NEXT;
}

real inverse_drive_v(inverse_state *s, real position_um) {
  real crept, position, lagging;
  inverse_advance(s, s->next);
  crept = inverse_creep(s, s->now + inverse_beside_now(s));
  position = inverse_requested(s, position_um, crept);
#ifndef INVERSE_OPEN_LOOPS /* loops that do not close leave 0 to 1 */
  position = inverse_clamp(position, s->command);
#endif
  lagging = inverse_lagging_for(s, position);
  s->next = inverse_clamp(lagging + inverse_behind(s, lagging), R(0));
  return inverse_volts(s->next);
}
