/* ---- self-test: the voltages of piezod for sines, decays, noise, NaN and a full memory ---- */

#ifdef SELF_TEST
#include <stdio.h>

$vectors

int main(void) {
  static inverse_state s;
  const real allowed = INVERSE_TOLERANCE, zero = R(0);
  real worst = R(0);
  int i;
  inverse_reset(&s);
  for (i = 0; i < INVERSE_VECTORS; i++) {
    real um = inverse_test_um[i] > R(1e29) ? zero / zero : inverse_test_um[i]; /* 1e30 is NaN */
    real off = inverse_drive_v(&s, um) - inverse_test_v[i];
    off = (off < R(0) ? -off : off) / (INVERSE_DRIVE_HIGH_V - INVERSE_DRIVE_LOW_V);
    if (!(off <= worst)) worst = off;
  }
  printf("%s: worst difference %.3g of the range, allowed %.3g; %lu pairs merged\n",
         worst <= allowed ? "passed" : "FAILED", (double)worst, (double)allowed, s.merged);
  return worst <= allowed ? 0 : 1;
}
#endif
