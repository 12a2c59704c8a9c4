"""Tests of the detection of an oscillation, at rest and in motion."""

import math
from collections.abc import Callable

import pytest

from piezod.control.watch.adaptation import Oscillation
from tests.control.fakes import MS


def found_after(
    command: Callable[[float], float], error: Callable[[float], float], duration_s: float = 3.0
) -> float:
    """Return the time at which an oscillation is found, in s, in a loop of 1 kHz; NaN if never."""
    wave = Oscillation(MS)
    for k in range(round(duration_s * 1e3)):
        t_s = 1e-3 * k
        wave.update(command(t_s), command(t_s) - error(t_s), 1e-4)
        if wave.found:
            return t_s
    return math.nan


def sine(hz: float, amplitude: float) -> Callable[[float], float]:
    """Return a sine over time, in s."""
    return lambda t_s: amplitude * math.sin(math.tau * hz * t_s)


def triangle(hz: float) -> Callable[[float], float]:
    """Return a triangle over the whole range."""
    return lambda t_s: abs(2.0 * (hz * t_s % 1.0) - 1.0)


@pytest.mark.fault("D6")
@pytest.mark.parametrize("hz", [0.1, 0.5, 5.0, 20.0])
@pytest.mark.parametrize("ringing_hz", [180.0, 400.0])
def test_ringing_is_found_while_the_command_moves(hz: float, ringing_hz: float) -> None:
    """An error of ±30 % of the range beside that of the lag, on a sine over the whole range."""
    lag, rings = sine(hz, 0.05), sine(ringing_hz, 0.3)

    assert found_after(sine(hz, 0.5), lambda t_s: lag(t_s) + rings(t_s)) < 1.5


@pytest.mark.parametrize("hz", [0.5, 3.0, 20.0, 100.0])
def test_errors_that_a_command_explains_are_none(hz: float) -> None:
    """A lag of a quarter of a period, with three harmonics of hysteresis, is healthy."""
    errors = [sine(hz, 0.4), sine(3 * hz, 0.05)]

    assert math.isnan(found_after(sine(hz, 0.5), lambda t_s: sum(each(t_s) for each in errors)))


@pytest.mark.parametrize("hz", [0.5, 5.0, 20.0])
def test_corners_of_a_command_may_ring_a_mode(hz: float) -> None:
    """A triangle rings a weakly damped mode at 400 Hz at each corner."""

    def rings(t_s: float) -> float:
        since_s = t_s % (0.5 / hz)
        amplitude = 4.0 * hz / (math.tau * 400.0)
        return amplitude * math.exp(-12.0 * since_s) * math.sin(math.tau * 400.0 * since_s)

    assert math.isnan(found_after(triangle(hz), rings))


def test_steps_may_ring_a_mode() -> None:
    """A square wave rings it anew before it has decayed."""
    assert math.isnan(
        found_after(
            lambda t_s: float(t_s % 0.2 < 0.1),
            lambda t_s: math.exp(-12.0 * (t_s % 0.1)) * math.cos(math.tau * 400.0 * t_s),
        )
    )


def test_history_is_forgotten() -> None:
    """After an interruption the detection takes as long as at the start."""
    wave, rings = Oscillation(MS), sine(100.0, 0.1)
    for k in range(1000):
        wave.update(0.5, 0.5 + rings(1e-3 * k), 0.0)
    was_found = wave.found
    wave.forget()

    assert (was_found, wave.found) == (True, False)
