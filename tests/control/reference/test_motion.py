"""Tests of movements: smooth, no faster than allowed, never out of the range."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.waveforms.shapes import Sine
from piezod.control.reference.motion import (
    MotionLimits,
    StreamedReference,
    lead_in,
    rest_at,
    smooth_motion,
    waveform_motion,
)

LIMITS = MotionLimits(speed_um_per_s=100.0, shortest_s=0.01, low_um=0.0, high_um=25.0)
positions = st.floats(0.0, 25.0)


@given(start_um=positions, target_um=positions)
def test_motion_from_standstill_stays_between_its_ends_and_is_not_too_fast(
    start_um: float, target_um: float
) -> None:
    """A minimum-jerk motion does not overshoot; its peak speed is 1.875 times its mean speed."""
    motion = smooth_motion(start_um, 0.0, target_um, LIMITS)
    t_s = np.linspace(0.0, motion.duration_s, 401)
    path_um = np.array([motion.reference_um(float(t)) for t in t_s])

    low_um, high_um = min(start_um, target_um), max(start_um, target_um)
    assert np.all((path_um >= low_um - 1e-9) & (path_um <= high_um + 1e-9))
    assert np.max(np.abs(np.diff(path_um))) <= 100.0 * t_s[1] * 1.001 + 1e-12
    assert motion.reference_um(0.0) == start_um
    assert motion.reference_um(motion.duration_s) == motion.target_um == target_um


@given(start_um=positions, target_um=positions, speed=st.floats(-200.0, 200.0))
def test_motion_continues_position_and_speed_and_stays_in_range(
    start_um: float, target_um: float, speed: float
) -> None:
    """A motion starts at the position and the speed of the reference before it."""
    motion = smooth_motion(start_um, speed, target_um, LIMITS)
    t_s = np.linspace(-0.1, 2.0 * motion.duration_s, 501)
    path_um = np.array([motion.reference_um(float(t)) for t in t_s])
    moved_um = motion.reference_um(1e-7) - start_um

    inside = 1e-3 < start_um < 25.0 - 1e-3
    assert np.all((path_um >= 0.0) & (path_um <= 25.0))
    assert not inside or moved_um == pytest.approx(speed * 1e-7, abs=1e-9)
    assert path_um[-1] == target_um


def test_short_motion_takes_the_shortest_duration() -> None:
    """A motion of one nanometre takes the shortest duration, too."""
    assert smooth_motion(1.0, 0.0, 1.001, LIMITS).duration_s == 0.01


def test_waveform_has_a_lead_in_and_holds_its_end() -> None:
    """The reference moves to the start of the waveform, follows it, and keeps its last value."""
    sine = Sine(kind="sine", low=0.0, high=20.0, frequency_hz=1.0).built(1.25)
    motion = waveform_motion(sine, 1.25, lead_in(sine, 5.0, 0.0, LIMITS))
    lead_in_s = motion.duration_s - 1.25

    assert motion.reference_um(0.0) == 5.0
    assert motion.reference_um(lead_in_s) == pytest.approx(0.0)
    assert motion.reference_um(lead_in_s + 0.5) == pytest.approx(20.0)
    assert motion.reference_um(9.0) == motion.target_um == pytest.approx(10.0)


def test_waveform_that_starts_at_the_reference_has_no_lead_in() -> None:
    """A waveform that starts at the position of the reference starts at once."""
    sine = Sine(kind="sine", low=5.0, high=20.0, frequency_hz=1.0).built(2.0)

    assert waveform_motion(sine, 2.0, lead_in(sine, 5.0, 0.0, LIMITS)).duration_s == 2.0


def test_rest_is_a_movement_without_duration() -> None:
    """The reference of a rest has one value for ever."""
    motion = rest_at(7.0)

    assert (motion.reference_um(0.0), motion.reference_um(1e6), motion.duration_s) == (7.0, 7.0, 0)


def test_stream_is_followed_no_faster_than_allowed() -> None:
    """The reference approaches a distant setpoint by speed times period in each cycle."""
    stream = StreamedReference(5.0, LIMITS, period_s=0.01)
    stream.newest_um = 7.5
    path_um = []
    for _ in range(4):
        stream.advance()
        path_um.append(stream(0.0))

    assert path_um == [6.0, 7.0, 7.5, 7.5]
