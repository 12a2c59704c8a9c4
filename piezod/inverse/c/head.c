/* $title
 *
 * The inverse of the hysteresis of a piezo stage: position in um -> voltage in V.
 * Written by piezod $version from $file: $operators, fitted to $source.
 *
 *   inverse_state s;
 *   inverse_reset(&s);                         with the stage at rest, at $rest_v V
 *   volts = inverse_drive_v(&s, position_um);  every 1/INVERSE_RATE_HZ s
 *
 * Positions count from rest. One outside $low_um to $high_um um counts as the nearest, NaN as the one
 * before; the voltage stays within $low_v to $high_v V. There is no limit of the slew rate.
 * A voltage shows INVERSE_LOOKAHEAD_S after its call: give the position of that instant.
 * $mode
 * C99 without allocation and library; every loop is bounded. Include this file, or declare its
 * functions. -DINVERSE_FLOAT: float instead of double. -DSELF_TEST: a program that tests itself.
 * -ffp-contract=off gives the same bits on every processor; -ffast-math is refused.
 */

#ifdef __FAST_MATH__
#error "compile without -ffast-math: it removes the tests for NaN"
#endif
#ifdef INVERSE_FLOAT
#define real float
#else
#define real double
#endif
#define R(x) ((real)(x))
