"""Tests of the preview filter: behind it a stage with modes follows."""

import numpy as np
import pytest
from hypothesis import assume, given, reject
from hypothesis import strategies as st

from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.preview import (
    BAND_PER_RATE,
    LARGEST_GAIN,
    LARGEST_INVERSE,
    LARGEST_MISFIT,
    PreviewFilter,
    preview_filter,
)
from piezod.errors import ModelError

PERIODS_S = st.floats(5e-5, 2e-3)
STACK = ResponseModel(0.0, (Resonance(734.0, 0.03),))


@st.composite
def single_modes(draw: st.DrawFn) -> ResponseModel:
    """Draw a stage with one mode."""
    return ResponseModel(
        0.0, (Resonance(draw(st.floats(30.0, 5000.0)), draw(st.floats(0.003, 0.5))),)
    )


@st.composite
def stages(draw: st.DrawFn) -> ResponseModel:
    """Draw a stage with up to three modes side by side, some against the others."""
    frequencies = sorted(draw(st.lists(st.floats(30.0, 5000.0), min_size=1, max_size=3)))
    shares = [draw(st.floats(0.1, 1.0)) * draw(st.sampled_from([1, 1, -1])) for _ in frequencies]
    total = sum(shares)
    assume(total > 0.2)
    modes = [
        Resonance(frequency_hz, draw(st.floats(0.003, 0.5)), share / total)
        for frequency_hz, share in zip(frequencies, shares, strict=True)
    ]
    return ResponseModel(0.0, tuple(modes))


def filter_of(stage: ResponseModel, period_s: float) -> PreviewFilter:
    """Return the filter of a stage; leave out the few stages that are refused."""
    try:
        return preview_filter(stage, period_s)
    except ModelError:
        reject()


def misfit(preview: PreviewFilter, stage: ResponseModel, period_s: float, part: float) -> float:
    """Return the largest error of the stage behind the filter, up to a part of the band."""
    f = np.linspace(0.0, part * preview.band_hz, 300)
    follows = preview.at(f, period_s) * stage.at(f) * np.sinc(f * period_s)
    return float(np.abs(follows - 1.0).max())


@given(stage=single_modes(), period_s=PERIODS_S)
def test_stage_with_one_mode_follows(stage: ResponseModel, period_s: float) -> None:
    """Within 0.1 % up to a fifth of the band, and within 1 % up to half of it."""
    preview = preview_filter(stage, period_s)

    assert misfit(preview, stage, period_s, 0.2) < 1e-3
    assert misfit(preview, stage, period_s, 0.5) < 1e-2


@given(stage=stages(), period_s=PERIODS_S)
def test_stage_with_several_modes_follows(stage: ResponseModel, period_s: float) -> None:
    """Within 5 % up to half of the band, which may be narrower than that of one mode."""
    preview = filter_of(stage, period_s)

    assert misfit(preview, stage, period_s, 0.5) < 1.1 * LARGEST_MISFIT


@given(stage=stages(), period_s=PERIODS_S)
def test_filter_is_bounded_and_keeps_a_constant(stage: ResponseModel, period_s: float) -> None:
    """No frequency is amplified by more than 2, and a constant command stays as it is."""
    preview = filter_of(stage, period_s)
    gain = np.abs(preview.at(np.linspace(0.0, 0.5 / period_s, 1000), period_s))

    assert gain.max() < 1.05 * LARGEST_GAIN
    assert preview.taps.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("frequency_hz", "error"), [(10, 1e-5), (50, 1e-4), (200, 5e-4)])
def test_stack_at_10_khz_follows_a_sine(frequency_hz: float, error: float) -> None:
    """Without the filter its mode makes a sine of 200 Hz larger by 8 %."""
    preview = preview_filter(STACK, 1e-4)
    f = np.array([float(frequency_hz)])

    assert abs(preview.at(f, 1e-4) * STACK.at(f) * np.sinc(f * 1e-4) - 1.0)[0] < error


def test_mode_in_the_band_is_not_excited() -> None:
    """At the mode the filter passes as much as the mode takes away: 2 ζ."""
    preview = preview_filter(STACK, 1e-4)

    assert abs(preview.at(np.array([734.0]), 1e-4)[0]) == pytest.approx(0.06, rel=0.05)
    assert preview.band_hz > 734.0


def test_band_ends_with_the_stage_or_with_the_rate() -> None:
    """At 10 kHz it ends where the inverse amplifies by 1.5, at 1 kHz at a quarter of the rate."""
    preview = preview_filter(STACK, 1e-4)

    assert abs(STACK.at(np.array([preview.band_hz]))[0]) == pytest.approx(1 / LARGEST_INVERSE, 0.01)
    assert preview_filter(STACK, 1e-3).band_hz == BAND_PER_RATE * 1000.0


def test_delay_of_the_stage_does_not_count() -> None:
    """The command is read ahead by the delay; the filter adds none."""
    late = ResponseModel(1e-3, STACK.resonances)

    assert np.array_equal(preview_filter(late, 1e-4).taps, preview_filter(STACK, 1e-4).taps)


def test_slow_mode_needs_no_more_taps_in_a_fast_loop() -> None:
    """The taps are several periods apart; they reach as far in time."""
    slow = ResponseModel(0.0, (Resonance(73.4, 0.03),))
    preview = preview_filter(slow, 1e-4)

    assert preview.taps.size == preview_filter(STACK, 1e-4).taps.size
    assert preview.ahead == pytest.approx(10 * preview_filter(STACK, 1e-5 * 10).ahead, rel=0.5)
    assert misfit(preview, slow, 1e-4, 0.2) < 1e-3
