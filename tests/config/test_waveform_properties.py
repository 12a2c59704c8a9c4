"""Tests of properties that all waveforms have."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from piezod.config.waveforms.combined import KINDS, pack_waveforms, unpack_waveforms
from piezod.config.waveforms.paths import Reversals
from piezod.config.waveforms.shapes import Chirp, Multisine, Setpoint, Sine, Triangle
from piezod.config.waveforms.waveform import WaveformModel
from piezod.errors import DataError
from tests.config.waveform_strategies import READER, quantities, waveforms

SINE = Sine(kind="sine", low=0.0, high=1.0, frequency_hz=1.0)
DURATION_S = 20.0

CONTINUOUS = waveforms(Sine, Triangle, Chirp, Multisine, Reversals, Setpoint)
CONTINUOUS_SUMS = st.lists(CONTINUOUS, min_size=2, max_size=3).map(
    lambda parts: {"kind": "sum", "parts": tuple(parts)}
)
ANY = waveforms()
TIMES = st.lists(st.floats(-10, 1e9) | st.floats(0, 30), min_size=1, max_size=20)


@given(keys=ANY, times_s=TIMES)
def test_bounds_hold_at_any_time(keys: dict[str, Any], times_s: list[float]) -> None:
    """No value is outside the bounds, not even by rounding."""
    config = READER.validate_python(keys)
    waveform = config.built(DURATION_S)
    values = [waveform.value(t_s) for t_s in times_s]

    assert (waveform.low, waveform.high) == config.bounds()
    assert [value for value in values if not waveform.low <= value <= waveform.high] == []


@given(keys=ANY, times_s=TIMES)
def test_samples_are_the_values(keys: dict[str, Any], times_s: list[float]) -> None:
    """Sampling at many times gives exactly the values at each time."""
    waveform = READER.validate_python(keys).built(DURATION_S)
    sampled = waveform.sample(np.array(times_s))

    assert sampled == [waveform.value(t_s) for t_s in times_s]


@given(keys=ANY, times_s=st.lists(st.floats(-1.0, DURATION_S), min_size=1, max_size=20))
def test_packed_waveform_has_the_same_values(keys: dict[str, Any], times_s: list[float]) -> None:
    """The loop gets the values and the bounds of the request, to the last bit."""
    config = READER.validate_python(keys)
    (packed,) = unpack_waveforms(pack_waveforms({"x": config}, DURATION_S)).values()
    given_, built = config.built(DURATION_S), packed.built(DURATION_S)

    assert (built.low, built.high) == (given_.low, given_.high)
    assert [built.value(t_s) for t_s in times_s] == [given_.value(t_s) for t_s in times_s]


@given(keys=ANY)
def test_before_the_start(keys: dict[str, Any]) -> None:
    """Before its start a waveform has its first value."""
    waveform = READER.validate_python(keys).built(DURATION_S)

    assert waveform.value(-1.0) == waveform.value(0.0)


@given(keys=ANY, t_s=st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300]))
def test_no_time_raises(keys: dict[str, Any], t_s: float) -> None:
    """A time that is not finite, or huge, gives a value within the bounds, or NaN."""
    waveform = READER.validate_python(keys).built(DURATION_S)
    value = waveform.value(t_s)

    assert math.isnan(value) or waveform.low <= value <= waveform.high


def steepest(keys: dict[str, Any]) -> float:
    """Return a speed, per s, that a continuous waveform cannot exceed."""
    match keys["kind"]:
        case "setpoint":
            return 0.0
        case "reversals":
            return float(keys["max_speed"])
        case "multisine":
            parts = keys["components"]
            return float(sum(math.tau * c["frequency_hz"] * c["amplitude"] for c in parts))
        case "sum":
            return sum(map(steepest, keys["parts"]))
    span, envelope = keys["high"] - keys["low"], keys["envelope"]
    fastest_hz = max(keys[name] for name in ("frequency_hz", "from_hz", "to_hz") if name in keys)
    speed = span * fastest_hz * (2 if keys["kind"] == "triangle" else math.pi)
    if envelope["kind"] == "modulated":
        speed += span * envelope["depth"] * math.pi * envelope["frequency_hz"]
    if envelope["kind"] == "decaying":
        speed += span * (1 - envelope["final_fraction"]) / envelope["time_constant_s"]
    return float(speed)


@given(keys=st.one_of(CONTINUOUS, CONTINUOUS_SUMS))
def test_values_change_without_steps(keys: dict[str, Any]) -> None:
    """Between two instants no value changes by more than the steepest slope allows."""
    waveform = READER.validate_python(keys).built(DURATION_S)
    times_s = np.arange(-0.01, 5.0, 1e-3)
    changes = np.abs(np.diff(waveform.sample(times_s)))

    assert np.max(changes) <= steepest(keys) * 1e-3 * (1 + 1e-6) + 1e-9


@given(keys=waveforms(Sine, Triangle, Chirp, Multisine, Reversals))
def test_swinging_waveforms_start_at_their_lowest(keys: dict[str, Any]) -> None:
    """A periodic waveform starts at `low`, if it has its full swing then and no phase is set."""
    if keys["kind"] == "multisine":
        keys["components"] = tuple(part | {"phase_deg": 0.0} for part in keys["components"])
    if keys.get("anchor") == "middle":
        keys["envelope"] = {"kind": "constant"}

    waveform = READER.validate_python(keys).built(DURATION_S)
    assert waveform.value(0.0) == keys["low"]


@given(keys=waveforms(Reversals))
def test_turning_points_keep_to_range_swing_and_speed(keys: dict[str, Any]) -> None:
    """Directions alternate, swings are long enough, speeds are within their limits."""
    config = Reversals.model_validate(keys)
    times_s, levels = map(np.array, config.corners(DURATION_S))
    tiny = 1e-9 * (1 + abs(config.low) + config.high - config.low)
    swings, speeds = np.diff(levels), np.abs(np.diff(levels)) / np.diff(times_s)

    assert (times_s[0], levels[0]) == (0.0, config.low)
    assert times_s[-1] >= DURATION_S > times_s[-2]
    assert np.all(levels >= config.low)
    assert np.all(levels <= config.high)
    assert np.all(np.sign(swings) == np.resize([1, -1], swings.size))
    assert np.all(np.abs(swings) >= config.min_swing - tiny)
    assert np.all(speeds >= config.min_speed * (1 - 1e-6) - tiny)
    assert np.all(speeds <= config.max_speed * (1 + 1e-6) + tiny)


@given(keys=ANY)
def test_no_frequency_is_above_the_highest(keys: dict[str, Any]) -> None:
    """The guard of the loop sees every frequency, of whatever kind of waveform or envelope."""
    config = READER.validate_python(keys)

    assert max(quantities(config, "Hz"), default=0.0) <= config.built(DURATION_S).highest_hz


@given(keys=ANY, factor=st.sampled_from([2.0, 8.0]), t_s=st.floats(0.0, 5.0))
def test_slowed_waveform_has_the_values_later(
    keys: dict[str, Any], factor: float, t_s: float
) -> None:
    """A waveform that is so many times slower has each value, and its frequencies, that much later.

    Random turning points of the same seed are the same ones, later.
    """
    config = READER.validate_python(keys)
    try:
        slow = config.slowed(factor).built(factor * DURATION_S)
    except DataError:
        assume(False)  # the times of a file are fixed
    built = config.built(DURATION_S)

    assert slow.highest_hz == pytest.approx(built.highest_hz / factor)
    assert (slow.low, slow.high) == (built.low, built.high)
    assert slow.value(factor * t_s) == pytest.approx(built.value(t_s), abs=1e-6)


@pytest.mark.parametrize("model", KINDS.values(), ids=list(KINDS))
def test_a_kind_that_leaves_a_method_out_cannot_be_used(model: type[WaveformModel]) -> None:
    """No part of the product guesses what a new kind does."""
    assert not getattr(model, "__abstractmethods__", None)
    with pytest.raises(TypeError, match="abstract"):
        WaveformModel.model_construct()


def test_unknown_kinds_are_refused() -> None:
    """Neither a waveform nor an envelope of an unknown kind becomes another one on its way."""
    (sine,) = pack_waveforms({"x": SINE}, 1.0).values()
    for packed in ({}, sine | {"kind": "unknown"}, sine | {"envelope": {"kind": "unknown"}}):
        with pytest.raises(KeyError):
            unpack_waveforms({"x": packed})
