"""Tests of a reference that is shaped from its past and future values."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.reference.motion import CornerFilter, MotionLimits, StreamedReference
from piezod.control.reference.preview import PreviewedReference, ReferenceShaper
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.modal import modal_step
from piezod.dynamics.preview import preview_filter

PERIOD_S = 1e-4
PREVIEW = preview_filter(ResponseModel(0.0, (Resonance(400.0, 0.03),)), PERIOD_S)


def counted(value: Callable[[float], float], times_s: list[float]) -> Callable[[float], float]:
    """Return a reference that records the times at which it is evaluated."""

    def reference(t_s: float) -> float:
        times_s.append(t_s)
        return value(t_s)

    return reference


def previewed(reference: Callable[[float], float]) -> PreviewedReference:
    """Return a shaped reference."""
    shaped = PreviewedReference(PREVIEW, PERIOD_S)
    shaped.follow(reference, moving=False)
    return shaped


def direct(reference: Callable[[float], float], t_s: float) -> float:
    """Return the shaped value, from all values that the filter needs."""
    side, step_s = PREVIEW.taps.size // 2, PREVIEW.spacing * PERIOD_S
    values = [reference(t_s + (k - side) * step_s) for k in range(PREVIEW.taps.size)]
    return float(PREVIEW.taps @ values)


def sine(t_s: float) -> float:
    """Return a sine of 100 Hz."""
    return 5.0 + 4.0 * math.sin(math.tau * 100.0 * t_s)


def test_filter_of_the_tests_has_taps_apart() -> None:
    """So that the tests cover it."""
    assert PREVIEW.spacing > 1


def test_value_is_that_of_the_filter() -> None:
    """At first straight lines between the taps make a small error, then there is none."""
    shaped = previewed(sine)
    values = [shaped.value(k * PERIOD_S) for k in range(300)]

    wanted = [direct(sine, k * PERIOD_S) for k in range(300)]
    assert values[0] == pytest.approx(wanted[0], abs=1e-12)
    assert values == pytest.approx(wanted, abs=0.05)
    assert values[2 * PREVIEW.ahead + 1 :] == pytest.approx(wanted[2 * PREVIEW.ahead + 1 :])


def test_reference_is_evaluated_once_in_a_cycle() -> None:
    """At the far end of the future; only the first cycle evaluates all taps."""
    times_s: list[float] = []
    shaped = previewed(counted(sine, times_s))
    shaped.value(0.0)
    at_first = len(times_s)
    for k in range(1, 100):
        shaped.value(k * PERIOD_S)

    assert at_first == PREVIEW.taps.size
    assert times_s[at_first:] == pytest.approx(
        [(k + PREVIEW.ahead) * PERIOD_S for k in range(1, 100)]
    )


@given(skipped=st.integers(2, 500))
def test_skipped_cycles_evaluate_the_taps_again(skipped: int) -> None:
    """The value after them belongs to its time, at a bounded cost."""
    times_s: list[float] = []
    shaped = previewed(counted(sine, times_s))
    for k in range(50):
        shaped.value(k * PERIOD_S)
    times_s.clear()
    t_s = (49 + skipped) * PERIOD_S

    assert shaped.value(t_s) == pytest.approx(direct(sine, t_s), abs=1e-9)
    assert len(times_s) == PREVIEW.taps.size


def test_next_reference_of_a_moving_stage_keeps_the_past() -> None:
    """A reference that goes on where the one before ends makes no difference."""
    shaped = previewed(sine)
    for k in range(200):
        shaped.value(k * PERIOD_S)
    start_s = 200 * PERIOD_S
    # Before its start the new reference knows nothing of the movement.
    shaped.follow(lambda t_s: sine(start_s + t_s) if t_s >= 0.0 else sine(start_s), moving=True)

    for k in range(300):
        value = shaped.value(k * PERIOD_S)
        assert value == pytest.approx(direct(sine, start_s + k * PERIOD_S), abs=0.05)


def test_next_reference_of_a_resting_stage_has_no_past() -> None:
    """A voltage that was forced, or a stream, has left other values behind."""
    shaped = previewed(lambda t_s: 100.0 * t_s)
    for k in range(200):
        shaped.value(k * PERIOD_S)
    shaped.follow(lambda _t_s: 3.0, moving=False)

    assert [shaped.value(k * PERIOD_S) for k in range(100)] == pytest.approx([3.0] * 100)


@given(value=st.floats(-1e3, 1e3), slope=st.floats(-1e3, 1e3))
def test_straight_line_stays_one(value: float, slope: float) -> None:
    """A line only lags by what the mode lags: 2ζ/ω; a constant stays as it is."""
    shaped = previewed(lambda t_s: value + slope * t_s)
    lead_s = 2.0 * 0.03 / (math.tau * 400.0)

    for k in range(50):
        ahead = value + slope * (k * PERIOD_S + lead_s)
        assert shaped.value(k * PERIOD_S) == pytest.approx(ahead, abs=1e-6 * (1.0 + abs(slope)))


def test_stream_has_no_preview() -> None:
    """Its future is unknown: its corners are rounded, as without a response."""
    limits = MotionLimits(100.0, 0.01, 0.0, 10.0)
    shaper = ReferenceShaper(PERIOD_S, 400.0, PREVIEW)

    stream = shaper.shape(StreamedReference(5.0, limits, PERIOD_S), moving=True)
    motion = shaper.shape(sine, moving=True)

    assert isinstance(stream, CornerFilter)
    assert isinstance(motion, PreviewedReference)


def test_motion_after_a_stream_has_no_past() -> None:
    """The stream was not kept, so that the values before it would be taken for its own."""
    limits = MotionLimits(100.0, 0.01, 0.0, 10.0)
    shaper = ReferenceShaper(PERIOD_S, 400.0, PREVIEW)
    first = shaper.shape(lambda _t_s: 9.0, moving=False)
    for k in range(100):
        first.value(k * PERIOD_S)
    shaper.shape(StreamedReference(5.0, limits, PERIOD_S), moving=True)
    second = shaper.shape(lambda _t_s: 5.0, moving=True)

    assert [second.value(k * PERIOD_S) for k in range(50)] == pytest.approx([5.0] * 50)


def test_without_a_response_nothing_changes() -> None:
    """The reference has its corners rounded, or is left as it is."""
    assert isinstance(ReferenceShaper(PERIOD_S, 400.0).shape(sine, moving=False), CornerFilter)
    plain = ReferenceShaper(PERIOD_S).shape(sine, moving=False)
    assert [plain.value(t) for t in (0.1, 0.2)] == [sine(0.1), sine(0.2)]


def test_corner_rings_the_mode_less() -> None:
    """A stage at rest that begins to move at constant speed: behind the filter it hardly rings."""
    mode = Resonance(400.0, 0.03)
    step = modal_step(mode, PERIOD_S)

    def ringing(values: np.ndarray) -> float:
        added, speed, before, found = 0.0, 0.0, float(values[0]), []
        for value in values.tolist():
            change, before = value - before, value
            added, speed = (
                step.added_added * added + step.added_speed * speed + step.added_step * change,
                step.speed_added * added + step.speed_speed * speed + step.speed_step * change,
            )
            found.append(added)
        return float(np.ptp(found[150:]))

    def corner(t_s: float) -> float:
        return max(0.0, t_s - 0.01)

    shaped = previewed(corner)
    times_s = [k * PERIOD_S for k in range(400)]
    behind = np.array([shaped.value(t_s) for t_s in times_s])
    assert ringing(behind) < 0.1 * ringing(np.array([corner(t_s) for t_s in times_s]))
