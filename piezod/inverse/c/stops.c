/* ---- hysteresis: a sum of stops, on a memory of positions ---- */

/* A turning point keeps the right plays, the left plays, and the sum of each side. */
#define INVERSE_LEFT INVERSE_ORDER
#define INVERSE_SUM_RIGHT (2 * INVERSE_ORDER)
#define INVERSE_SUM_LEFT (2 * INVERSE_ORDER + 1)

/* A right play waits at its value at the minimum until it meets its line. */
static real inverse_right(int j, real x, const real *bottom) {
  real line = (x - inverse_right_threshold[j]) * inverse_right_slope[j];
  return line > bottom[j] ? line : bottom[j];
}

static real inverse_left(int j, real x, const real *top) {
  real line = x * inverse_left_slope[j];
  return line < top[INVERSE_LEFT + j] ? line : top[INVERSE_LEFT + j];
}

/* What the side that does not follow the chord adds. Four sums, because one would be a chain. */
static real inverse_rise(real x, const real *bottom) {
  real a = R(0), b = R(0), c = R(0), d = R(0);
  int j;
  for (j = 0; j < INVERSE_ORDER; j += 4) {
    a += inverse_right_factor[j] * (x - inverse_right(j, x, bottom));
    b += inverse_right_factor[j + 1] * (x - inverse_right(j + 1, x, bottom));
    c += inverse_right_factor[j + 2] * (x - inverse_right(j + 2, x, bottom));
    d += inverse_right_factor[j + 3] * (x - inverse_right(j + 3, x, bottom));
  }
  return (a + b) + (c + d);
}

static real inverse_fall(real x, const real *top) {
  real a = R(0), b = R(0), c = R(0), d = R(0);
  int j;
  for (j = 0; j < INVERSE_ORDER; j += 4) {
    a += inverse_left_factor[j] * (x - inverse_left(j, x, top));
    b += inverse_left_factor[j + 1] * (x - inverse_left(j + 1, x, top));
    c += inverse_left_factor[j + 2] * (x - inverse_left(j + 2, x, top));
    d += inverse_left_factor[j + 3] * (x - inverse_left(j + 3, x, top));
  }
  return (a + b) + (c + d);
}

static void inverse_store(inverse_state *s, int side) {
  const int t = s->count[INVERSE_TOP] - 1, b = s->count[INVERSE_BOTTOM] - 1;
  const real *top = s->value[INVERSE_TOP][t], *bottom = s->value[INVERSE_BOTTOM][b];
  const real x = s->last, low = s->level[INVERSE_BOTTOM][b];
  const real part = (x - low) / (s->level[INVERSE_TOP][t] - low);
  real *to = s->value[side][s->count[side]];
  int j;
  if (side == INVERSE_TOP) {
    for (j = 0; j < INVERSE_ORDER; j++) to[j] = inverse_right(j, x, bottom);
    for (j = INVERSE_LEFT; j < 2 * INVERSE_ORDER; j++)
      to[j] = bottom[j] + (top[j] - bottom[j]) * part;
  } else {
    for (j = 0; j < INVERSE_ORDER; j++) to[j] = bottom[j] + (top[j] - bottom[j]) * part;
    for (j = 0; j < INVERSE_ORDER; j++) to[INVERSE_LEFT + j] = inverse_left(j, x, top);
  }
  to[INVERSE_SUM_RIGHT] = s->right;
  to[INVERSE_SUM_LEFT] = s->left;
  s->level[side][s->count[side]++] = x;
}

/* Paper eq. (16): the position and what each side adds to it. */
static real inverse_output(inverse_state *s, real x) {
  const int t = s->count[INVERSE_TOP] - 1, b = s->count[INVERSE_BOTTOM] - 1;
  const real *top = s->value[INVERSE_TOP][t], *bottom = s->value[INVERSE_BOTTOM][b];
  const real low = s->level[INVERSE_BOTTOM][b];
  const real part = (x - low) / (s->level[INVERSE_TOP][t] - low);
  const int chord = s->rising ? INVERSE_SUM_LEFT : INVERSE_SUM_RIGHT;
  const real along = bottom[chord] + (top[chord] - bottom[chord]) * part;
  s->right = s->rising ? inverse_rise(x, bottom) : along;
  s->left = s->rising ? along : inverse_fall(x, top);
  return x + s->right + s->left;
}

void inverse_reset(inverse_state *s) {
  int j;
  inverse_relax(s);
  for (j = 0; j < 2 * INVERSE_ORDER; j++) s->value[INVERSE_TOP][0][j] = R(1);
  for (j = 0; j < INVERSE_TURNS; j++) {
    inverse_locate(s, inverse_start[j]);
    inverse_output(s, inverse_start[j]);
    inverse_commit(s, inverse_start[j]);
  }
}

real inverse_drive_v(inverse_state *s, real position_um) {
  real crept = inverse_creep(s, s->last), out;
  real x = inverse_requested(s, position_um, crept);
  x = inverse_clamp(x, s->command);
  inverse_locate(s, x);
  out = inverse_output(s, x);
  inverse_commit(s, x);
  return inverse_volts(out);
}
