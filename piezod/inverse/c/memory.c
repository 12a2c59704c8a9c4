/* ---- memory: the turning points that still count; the outermost ones come first ---- */

typedef struct {
  real level[2][INVERSE_EXTREMA + 1];                /* inputs at the turning points */
  real value[2][INVERSE_EXTREMA + 1][INVERSE_WIDTH]; /* what the operators had there */
  real last;                                         /* last input */
  real command;                                      /* last position asked for */
  int count[2];                                      /* number of turning points */
  int rising;                                        /* whether the last move rose */
  unsigned long merged;                              /* pairs that a full memory has removed */
#if INVERSE_LAGS
  real lag[INVERSE_LAGS];
  real lost[INVERSE_LAGS]; /* what rounding took from the lags; used by float only */
#endif
#ifdef INVERSE_SURFACE
  real now, next, raw, pinned, change;
#else
  real right, left; /* what each side adds to the last input */
#endif
} inverse_state;

enum { INVERSE_TOP, INVERSE_BOTTOM };

/* The form of the model: the last input becomes a turning point. */
static void inverse_store(inverse_state *s, int side);

static real inverse_clamp(real value, real fallback) {
  if (value >= R(1)) return R(1);
  if (value >= R(0)) return value;
  if (value < R(0)) return R(0);
  return fallback; /* only NaN fails all three comparisons */
}

/* Find the loop of an input. One that reaches a turning point deletes the loop inside it. */
static void inverse_locate(inverse_state *s, real input) {
  int *n = s->count;
  if (input > s->last) {
    if (!s->rising) inverse_store(s, INVERSE_BOTTOM);
    while (n[INVERSE_TOP] > 1 && input >= s->level[INVERSE_TOP][n[INVERSE_TOP] - 1]) {
      n[INVERSE_TOP]--;
      n[INVERSE_BOTTOM]--;
    }
    s->rising = 1;
  } else if (input < s->last) {
    if (s->rising) inverse_store(s, INVERSE_TOP);
    while (n[INVERSE_BOTTOM] > 1 && input <= s->level[INVERSE_BOTTOM][n[INVERSE_BOTTOM] - 1]) {
      n[INVERSE_BOTTOM]--;
      n[INVERSE_TOP]--;
    }
    s->rising = 0;
  }
}

static void inverse_remove(inverse_state *s, int side, int index) {
  int i, j;
  s->count[side]--;
  for (i = index; i < s->count[side]; i++) {
    s->level[side][i] = s->level[side][i + 1];
    for (j = 0; j < INVERSE_WIDTH; j++) s->value[side][i][j] = s->value[side][i + 1][j];
  }
}

/* A full memory loses the pair of neighbours whose longer side is the shortest. */
static void inverse_merge(inverse_state *s) {
  const real *top = s->level[INVERSE_TOP], *bottom = s->level[INVERSE_BOTTOM];
  real shortest = R(2);
  int i, at_top = 1, at_bottom = 1;
  for (i = 1; i < s->count[INVERSE_BOTTOM] - 1; i++) {
    real drop = top[i] - top[i + 1], before = bottom[i] - bottom[i - 1];
    real after = bottom[i + 1] - bottom[i];
    real side = drop > before ? drop : before;
    if (side < shortest) {
      shortest = side;
      at_top = i;
      at_bottom = i;
    }
    side = drop > after ? drop : after;
    if (side < shortest) {
      shortest = side;
      at_top = i + 1;
      at_bottom = i;
    }
  }
  inverse_remove(s, INVERSE_TOP, at_top);
  inverse_remove(s, INVERSE_BOTTOM, at_bottom);
  s->merged++;
}

static void inverse_commit(inverse_state *s, real input) {
  const int *n = s->count;
  s->last = input;
  if ((n[INVERSE_TOP] > n[INVERSE_BOTTOM] ? n[INVERSE_TOP] : n[INVERSE_BOTTOM]) > INVERSE_EXTREMA)
    inverse_merge(s);
}

/* ---- creep: slow lags of the position without creep ---- */

static real inverse_creep(inverse_state *s, real before) {
  real crept = R(0);
#if INVERSE_LAGS
  int k;
  for (k = 0; k < INVERSE_LAGS; k++) {
#ifdef INVERSE_FLOAT
    /* A step is often smaller than a float can add, so that the rest is kept. */
    real step = inverse_lag_gain[k] * (before - s->lag[k] - s->lost[k]) + s->lost[k];
    volatile real sum = s->lag[k] + step;
    s->lost[k] = step - (sum - s->lag[k]);
    s->lag[k] = sum;
#else
    s->lag[k] += inverse_lag_gain[k] * (before - s->lag[k]);
#endif
    crept += inverse_lag_weight[k] * s->lag[k];
  }
#else
  (void)s;
  (void)before;
#endif
  return crept;
}

/* The memory before the stage has moved. */
static void inverse_relax(inverse_state *s) {
  unsigned char *byte = (unsigned char *)s;
  unsigned long i;
  for (i = 0; i < sizeof *s; i++) byte[i] = 0;
  s->level[INVERSE_TOP][0] = R(1);
  s->count[INVERSE_TOP] = s->count[INVERSE_BOTTOM] = 1;
  s->rising = 1;
  s->command = INVERSE_START_COMMAND;
#if INVERSE_LAGS
  for (i = 0; i < INVERSE_LAGS; i++) s->lag[i] = inverse_lag_start[i];
#endif
}

/* The position that the hysteresis has to make, 0 to 1 for the range of the model. */
static real inverse_requested(inverse_state *s, real position_um, real crept) {
  real unit = (position_um - INVERSE_POSITION_LOW_UM) /
              (INVERSE_POSITION_HIGH_UM - INVERSE_POSITION_LOW_UM);
  s->command = inverse_clamp(unit, s->command);
  return s->command + INVERSE_ZEROED - crept;
}

static real inverse_volts(real drive) {
  drive = inverse_clamp(drive, R(0));
  return INVERSE_DRIVE_LOW_V + drive * (INVERSE_DRIVE_HIGH_V - INVERSE_DRIVE_LOW_V);
}
