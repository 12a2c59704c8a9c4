"""The delay of a sample behind a voltage that is held from cycle to cycle, at any rate.

The voltage counts as a straight line from cycle to cycle, and a sample is taken just before the
next write. Of a slow ramp, whose every step shows as s(t), a sample after k cycles lacks
Σ (1 - s(j T)), j = 1 to k. The sum times T is the delay: T/2 less than that of a continuous drive
if the stage is slow against T, and none if it has settled within T.

Amplifier and filter of the sensor are taken as two equal lags, whatever they are: for those of the
simulated stack, delays at 1 kHz and 10 kHz agree within 0.01 ms. A negative delay of up to half a
period comes from a mode that rings on from cycle to cycle: then the sum is near -1/2 at any rate.
What is beyond that is a time by which samples are told early.
"""

from math import exp, pi, tan

from piezod.config.first_mode import FirstModeConfig


def delay_at(delay_s: float, held_s: float, period_s: float) -> float:
    """Return the delay in a loop with another period, in s.

    Args:
        delay_s: Delay where each voltage was held for `held_s`, in s.
        held_s: That time, in s; 0 if the voltage changed evenly.
        period_s: Period of the loop, in s.
    """
    if held_s == period_s:
        return delay_s
    if delay_s <= 0.0:
        rings_s = max(delay_s, -0.5 * held_s)
        return (rings_s * period_s / held_s if held_s else 0.0) + delay_s - rings_s
    return _sampled_s(_continuous_s(delay_s, held_s), period_s)


def stage_delay(
    delay_s: float, sensor_delay_s: float, period_s: float, mode: FirstModeConfig | None
) -> float:
    """Return the delay of the stage itself, at the instants of the cycles, in s.

    That of a stage which is slow against T is less by the delay of the sensor. If its first mode
    rings on from cycle to cycle, its own sum is near -1/2, whatever the sensor shows; it is smaller
    if less than the whole ring is left after T. Between both, with a mode that turns by 2 x in a
    cycle, x / tan(x) of the lag behind -T/2 remains.

    Args:
        delay_s: Delay of the samples, in s.
        sensor_delay_s: Delay of the sensor, in s; 0 if samples count as the stage.
        period_s: Period of the loop, in s.
        mode: First mode; None if it is unknown: the stage then counts as slow.
    """
    if sensor_delay_s == 0.0:
        return delay_s
    left = exp(-2.0 * pi * mode.damping * mode.frequency_hz * period_s) if mode else 1.0
    behind_s = max(delay_s + 0.5 * period_s - sensor_delay_s, 0.0)
    return shown_share(period_s, mode) * behind_s - period_s * left * (1.0 - 0.5 * left)


def shown_share(period_s: float, mode: FirstModeConfig | None) -> float:
    """Return the share of a lag of the stage that its instants show, from 0 to 1.

    Args:
        period_s: Period of the loop, in s.
        mode: First mode; None if it is unknown.
    """
    angle = pi * mode.frequency_hz * period_s if mode else 0.0
    if angle == 0.0:
        return 1.0
    return angle / tan(angle) if angle < 0.5 * pi else 0.0


def _continuous_s(delay_s: float, held_s: float) -> float:
    """Return the delay behind a drive that changes evenly, in s."""
    low_s, high_s = 0.0, delay_s + held_s  # a hold takes at most half of its time from the delay
    for _ in range(60):  # to the last bit
        middle_s = 0.5 * (low_s + high_s)
        if _sampled_s(middle_s, held_s) < delay_s:
            low_s = middle_s
        else:
            high_s = middle_s
    return high_s


def _sampled_s(continuous_s: float, period_s: float) -> float:
    """Return the delay behind a voltage that is held for a period, in s."""
    if continuous_s <= 0.0 or period_s == 0.0:
        return continuous_s
    # Two lags of time constant τ: 1 - s(t) = (1 + t/τ) exp(-t/τ).
    periods = 2.0 * period_s / continuous_s
    kept = exp(-periods)
    left = 1.0 - kept
    return period_s * kept * (1.0 + periods / left) / left
