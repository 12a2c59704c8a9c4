"""Tests of properties that all waveforms have."""

import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from piezod.config.combined_waveforms import WaveformConfig
from piezod.config.packed_waveforms import pack_waveforms, unpack_waveforms
from piezod.config.random_path import random_path
from piezod.config.waveforms import Reversals
from piezod.control.reference.waveforms import build_waveform

DURATION_S = 20.0
READER: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)

LEVELS = st.floats(-100, 100)
FREQUENCIES = st.floats(0.01, 50)
RANGES = st.tuples(LEVELS, st.floats(0.5, 100)).map(
    lambda pair: {"low": pair[0], "high": pair[0] + pair[1]}
)
ENVELOPES = st.one_of(
    st.just({"kind": "constant"}),
    st.fixed_dictionaries(
        {
            "kind": st.just("modulated"),
            "depth": st.floats(0, 1),
            "frequency_hz": st.floats(0.01, 5),
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("decaying"),
            "time_constant_s": st.floats(0.1, 100),
            "final_fraction": st.floats(0, 1),
        }
    ),
)


@st.composite
def periodic_configs(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a sine or a triangle."""
    return draw(RANGES) | {
        "kind": draw(st.sampled_from(["sine", "triangle"])),
        "frequency_hz": draw(FREQUENCIES),
        "envelope": draw(ENVELOPES),
        "anchor": draw(st.sampled_from(["low", "middle"])),
    }


@st.composite
def multisine_configs(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a sum of sinusoids."""
    component = st.fixed_dictionaries(
        {
            "amplitude": st.floats(0.1, 50),
            "frequency_hz": FREQUENCIES,
            "phase_deg": st.floats(-360, 360),
        }
    )
    components = tuple(draw(st.lists(component, min_size=1, max_size=4)))
    return {"kind": "multisine", "low": draw(LEVELS), "components": components}


@st.composite
def reversals_configs(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a path between random turning points."""
    keys = draw(RANGES)
    span = keys["high"] - keys["low"]
    min_swing = draw(st.floats(0.01, 1)) * span
    min_speed = draw(st.floats(0.1, 2)) * min_swing
    return keys | {
        "kind": "reversals",
        "min_swing": min(min_swing, span),
        "min_speed": min_speed,
        "max_speed": min_speed * draw(st.floats(1, 5)),
        "seed": draw(st.integers(0, 2**32 - 1)),
    }


STAIRCASES = st.fixed_dictionaries(
    {
        "kind": st.just("staircase"),
        "levels": st.lists(LEVELS, min_size=1, max_size=6).map(tuple),
        "dwell_s": st.floats(0.01, 10),
    }
)
SETPOINTS = st.fixed_dictionaries({"kind": st.just("setpoint"), "level": LEVELS})
CONTINUOUS = st.one_of(periodic_configs(), multisine_configs(), reversals_configs(), SETPOINTS)
SINGLE = st.one_of(CONTINUOUS, STAIRCASES)
CONTINUOUS_SUMS = st.lists(CONTINUOUS, min_size=2, max_size=3).map(
    lambda parts: {"kind": "sum", "parts": tuple(parts)}
)
SUMS = st.lists(SINGLE, min_size=2, max_size=3).map(
    lambda parts: {"kind": "sum", "parts": tuple(parts)}
)
PARTS = st.fixed_dictionaries({"duration_s": st.floats(0.1, 10), "waveform": SINGLE | SUMS})
SEQUENCES = st.lists(PARTS, min_size=1, max_size=3).map(
    lambda parts: {"kind": "sequence", "parts": tuple(parts)}
)
POINTS = st.lists(
    st.tuples(st.floats(0.0, 30.0), LEVELS),
    min_size=1,
    max_size=20,
    unique_by=lambda point: point[0],
).map(lambda points: {"kind": "points", "points": tuple(sorted(points))})
ANY = st.one_of(SINGLE, SUMS, SEQUENCES)
TIMES = st.lists(st.floats(-10, 1e9) | st.floats(0, 30), min_size=1, max_size=20)


@given(keys=ANY, times_s=TIMES)
def test_bounds_hold_at_any_time(keys: dict[str, Any], times_s: list[float]) -> None:
    """No value is outside the bounds, not even by rounding."""
    config = READER.validate_python(keys)
    waveform = build_waveform(config, DURATION_S)
    values = [waveform.value(t_s) for t_s in times_s]

    assert (waveform.low, waveform.high) == config.bounds()
    assert [value for value in values if not waveform.low <= value <= waveform.high] == []


@given(keys=ANY, times_s=TIMES)
def test_samples_are_the_values(keys: dict[str, Any], times_s: list[float]) -> None:
    """Sampling at many times gives exactly the values at each time."""
    waveform = build_waveform(READER.validate_python(keys), DURATION_S)
    sampled = waveform.sample(np.array(times_s))

    assert sampled.dtype == np.float64
    assert sampled.tolist() == [waveform.value(t_s) for t_s in times_s]


@given(keys=ANY | POINTS, times_s=st.lists(st.floats(-1.0, DURATION_S), min_size=1, max_size=20))
def test_packed_waveform_has_the_same_values(keys: dict[str, Any], times_s: list[float]) -> None:
    """The loop gets the values and the bounds of the request, to the last bit."""
    config = READER.validate_python(keys)
    (packed,) = unpack_waveforms(pack_waveforms({"x": config}, DURATION_S)).values()
    given_, built = build_waveform(config, DURATION_S), build_waveform(packed, DURATION_S)

    assert (built.low, built.high) == (given_.low, given_.high)
    assert [built.value(t_s) for t_s in times_s] == [given_.value(t_s) for t_s in times_s]


@given(keys=ANY)
def test_before_the_start(keys: dict[str, Any]) -> None:
    """Before its start a waveform has its first value."""
    waveform = build_waveform(READER.validate_python(keys), DURATION_S)

    assert waveform.value(-1.0) == waveform.value(0.0)


@given(keys=ANY, t_s=st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300]))
def test_no_time_raises(keys: dict[str, Any], t_s: float) -> None:
    """A time that is not finite, or huge, gives a value within the bounds, or NaN."""
    waveform = build_waveform(READER.validate_python(keys), DURATION_S)
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
    speed = span * keys["frequency_hz"] * (math.pi if keys["kind"] == "sine" else 2)
    if envelope["kind"] == "modulated":
        speed += span * envelope["depth"] * math.pi * envelope["frequency_hz"]
    if envelope["kind"] == "decaying":
        speed += span * (1 - envelope["final_fraction"]) / envelope["time_constant_s"]
    return float(speed)


@given(keys=st.one_of(CONTINUOUS, CONTINUOUS_SUMS))
def test_values_change_without_steps(keys: dict[str, Any]) -> None:
    """Between two instants no value changes by more than the steepest slope allows."""
    waveform = build_waveform(READER.validate_python(keys), DURATION_S)
    times_s = np.arange(-0.01, 5.0, 1e-3)
    changes = np.abs(np.diff(waveform.sample(times_s)))

    assert np.max(changes) <= steepest(keys) * 1e-3 * (1 + 1e-6) + 1e-9


@given(keys=st.one_of(periodic_configs(), multisine_configs(), reversals_configs()))
def test_swinging_waveforms_start_at_their_lowest(keys: dict[str, Any]) -> None:
    """A periodic waveform starts at `low`, if it has its full swing then and no phase is set."""
    if keys["kind"] == "multisine":
        keys["components"] = tuple(part | {"phase_deg": 0.0} for part in keys["components"])
    if keys.get("anchor") == "middle":
        keys["envelope"] = {"kind": "constant"}

    waveform = build_waveform(READER.validate_python(keys), DURATION_S)
    assert waveform.value(0.0) == keys["low"]


@given(keys=reversals_configs())
def test_turning_points_keep_to_range_swing_and_speed(keys: dict[str, Any]) -> None:
    """Directions alternate, swings are long enough, speeds are within their limits."""
    config = Reversals.model_validate(keys)
    points = np.array(random_path(config, DURATION_S))
    (times_s, levels), tiny = points.T, 1e-9 * (1 + abs(config.low) + config.high - config.low)
    swings, speeds = np.diff(levels), np.abs(np.diff(levels)) / np.diff(times_s)

    assert (times_s[0], levels[0]) == (0.0, config.low)
    assert times_s[-1] >= DURATION_S > times_s[-2]
    assert np.all(levels >= config.low)
    assert np.all(levels <= config.high)
    assert np.all(np.sign(swings) == np.resize([1, -1], swings.size))
    assert np.all(np.abs(swings) >= config.min_swing - tiny)
    assert np.all(speeds >= config.min_speed * (1 - 1e-6) - tiny)
    assert np.all(speeds <= config.max_speed * (1 + 1e-6) + tiny)
