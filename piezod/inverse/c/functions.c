/* ---- square root, exponential and logarithm without a library ---- */

static real inverse_root(real x) {
  real scale = R(1), y;
  int i;
  if (!(x > R(1e-24))) return R(0); /* narrower loops move nothing */
  for (i = 0; x < R(0.25) && i < 64; i++) {
    x *= R(4);
    scale *= R(0.5);
  }
  for (i = 0; x > R(1) && i < 64; i++) {
    x *= R(0.25);
    scale *= R(2);
  }
  y = R(0.35) + R(0.65) * x;
  for (i = 0; i < 5; i++) y = R(0.5) * (y + x / y);
  return y * scale;
}

#if defined INVERSE_LAG || defined INVERSE_PATH
#define INVERSE_LN2_HIGH R(0x1.62e42feep-1)
#define INVERSE_LN2_LOW R(0x1.a39ef35793c76p-33)

static real inverse_exp(real x) {
  real sum = R(1), rest;
  int n, i;
  if (x < R(-700)) return R(0);
  n = (int)(x * R(1.4426950408889634) + (x < R(0) ? R(-0.5) : R(0.5)));
  rest = (x - (real)n * INVERSE_LN2_HIGH) - (real)n * INVERSE_LN2_LOW;
  for (i = 14; i > 0; i--) sum = R(1) + sum * rest / (real)i;
  for (; n > 0; n--) sum *= R(2);
  for (; n < 0; n++) sum *= R(0.5);
  return sum;
}

/* ln(1 + x) for x >= 0 */
static real inverse_log1(real x) {
  real u = R(1) + x, z, square, sum = R(0);
  int n = 0, i;
  while (u > R(1.4142135623730951) && n < 1100) {
    u *= R(0.5);
    n++;
  }
  if (n > 0) x = u - R(1);
  z = x / (R(2) + x);
  square = z * z;
  for (i = 23; i > 1; i -= 2) sum = (sum + R(1) / (real)i) * square;
  return (real)n * INVERSE_LN2_HIGH + (R(2) * z * (R(1) + sum) + (real)n * INVERSE_LN2_LOW);
}

#ifdef INVERSE_EXPONENT
/* x to the power p, for x > 0 */
static real inverse_power(real x, real p) {
  return inverse_exp(p * (x < R(1) ? -inverse_log1(R(1) / x - R(1)) : inverse_log1(x - R(1))));
}
#endif
#endif
