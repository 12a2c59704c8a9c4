"""The excitation of a response: within the limits of the axis, in whole periods."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config.axes import LimitsConfig
from piezod.config.waveforms.combined import pack_waveforms
from piezod.errors import DataError
from piezod.experiment.response.plan import ResponsePlan, Wanted, plan_response
from piezod.messages.requests import Identify

LIMITS = LimitsConfig(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=20_000.0, rest_v=0.0)
OFFSETS_V, SLEWS_V_PER_S = st.floats(30.0, 120.0), st.floats(50.0, 1e5)


def plan_of(wanted: Wanted, rate_hz: float = 1000.0, limits: LimitsConfig = LIMITS) -> ResponsePlan:
    """Return the plan about one voltage."""
    (plan,) = plan_response(wanted, limits, 50.0, rate_hz)
    return plan


def assert_within(rate_hz: float, offset_v: float, slew_v_per_s: float, periods: int) -> None:
    """Assert that a drive with default amplitudes is within range and slew rate."""
    limits = LIMITS.model_copy(update={"slew_v_per_s": slew_v_per_s})
    plan = plan_of(Wanted((offset_v,), periods=periods), rate_hz, limits)

    drive_v = plan.sampled_v()

    assert 0.0 <= drive_v.min() <= drive_v.max() <= 150.0
    assert np.max(np.abs(np.diff(drive_v))) * rate_hz <= slew_v_per_s * (1.0 + 1e-9)
    low_v, high_v = plan.drive_v.bounds()
    assert 0.0 <= low_v < high_v <= 150.0


@settings(max_examples=4)
@given(st.floats(200.0, 3000.0), OFFSETS_V, SLEWS_V_PER_S, st.integers(2, 4))
def test_drive_is_within_range_and_slew_rate(
    rate_hz: float, offset_v: float, slew_v_per_s: float, periods: int
) -> None:
    """With default amplitudes the guard changes nothing of the drive."""
    assert_within(rate_hz, offset_v, slew_v_per_s, periods)


@pytest.mark.stress
@settings(max_examples=100)
@given(st.floats(200.0, 10_000.0), OFFSETS_V, SLEWS_V_PER_S, st.integers(4, 10))
def test_long_and_fast_drive_is_within_range_and_slew_rate(
    rate_hz: float, offset_v: float, slew_v_per_s: float, periods: int
) -> None:
    """The guard changes nothing at rates up to 10 kHz, either."""
    assert_within(rate_hz, offset_v, slew_v_per_s, periods)


def test_averaged_part_repeats_and_has_only_the_lines() -> None:
    """Its periods are equal, and whole: their spectrum has the lines and nothing between."""
    plan = plan_of(Wanted())
    end = plan.first + plan.periods * plan.period
    part = plan.sampled_v()[plan.first : end].reshape(plan.periods, plan.period)

    spectrum = np.abs(np.fft.rfft(part[0] - plan.offset_v))

    assert np.ptp(part, axis=0).max() < 1e-6
    assert np.delete(spectrum, plan.harmonics).max() < 1e-6 * spectrum.max()
    assert spectrum[plan.harmonics].min() > 0.05 * spectrum.max()
    assert np.max(np.abs(part[0] - plan.offset_v)) == pytest.approx(plan.amplitude_v, rel=0.05)


def test_multisine_begins_without_a_jump() -> None:
    """Between the last step and the multisine the drive moves by a part of the amplitude."""
    plan = plan_of(Wanted())
    begin = plan.first - int(np.ceil(0.5 * plan.rate_hz / plan.period)) * plan.period

    assert abs(np.diff(plan.sampled_v())[begin - 1]) < 0.3 * plan.amplitude_v


def test_drive_fits_into_a_request() -> None:
    """The daemon takes as many sinusoids as the longest drive has."""
    plan = plan_of(Wanted((75.0,), None, 0.1, 400.0))
    request = Identify(drive_v={"x": plan.drive_v}, duration_s=plan.duration_s)

    assert plan.harmonics.size > 60  # more than one multisine has
    pack_waveforms(request.drive_v, plan.duration_s)


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        (Wanted(amplitude_v=80.0), r"80 V about 75 V exceeds range or slew .* at most [\d.]+ V"),
        (Wanted((0.0,)), r"an offset of 0 V leaves no room .* above 0 and below 150 V"),
        (Wanted((75.0, 160.0)), r"an offset of 160 V leaves no room"),
        (Wanted(high_hz=500.0), r"500 Hz cannot be measured at 1000 Hz, allowed: below 500 Hz"),
        (Wanted(low_hz=300.0), r"one line only between 300 and 450 Hz"),
    ],
)
def test_what_is_not_possible_is_refused(wanted: Wanted, why: str) -> None:
    """Each refusal has the value and the allowed ones."""
    with pytest.raises(DataError, match=why):
        plan_of(wanted)


def test_refusal_names_an_amplitude_that_is_allowed() -> None:
    """The largest allowed amplitude of the message is accepted."""
    with pytest.raises(DataError) as refused:
        plan_of(Wanted(amplitude_v=80.0))
    largest_v = float(str(refused.value).partition("at most ")[2].partition(" V")[0])

    assert plan_of(Wanted(amplitude_v=largest_v)).amplitude_v == largest_v
