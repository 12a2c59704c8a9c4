"""Tests of the limits of waveforms for the loop; their values are tested with the waveforms."""

from typing import Any

import pytest
from pydantic import TypeAdapter

from piezod.config.waveforms.combined import WaveformConfig, pack_waveforms
from piezod.config.waveforms.waveform import MAX_POINTS, MAX_TERMS, WaveformCostError

READER: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)
TINY = {
    "kind": "reversals", "low": 0.0, "high": 20.0, "min_swing": 1e-6, "min_speed": 1e-6,
    "max_speed": 2e-4, "seed": 1,
}  # fmt: skip
SINE = {"kind": "sine", "low": 0.0, "high": 1.0, "frequency_hz": 1.0}


def config(keys: dict[str, Any]) -> WaveformConfig:
    """Return a validated waveform."""
    return READER.validate_python(keys)


def staircase(levels: int) -> dict[str, Any]:
    """Return a staircase of so many levels."""
    return {"kind": "staircase", "levels": (1.0,) * levels, "dwell_s": 0.1}


def multisine(components: int) -> dict[str, Any]:
    """Return a sum of so many sinusoids."""
    one = {"amplitude": 1.0, "frequency_hz": 1.0}
    return {"kind": "multisine", "low": 0.0, "components": (one,) * components}


def wiggle(swing: float) -> dict[str, Any]:
    """Return a path of swings of one size, 200 per s."""
    speed = 200.0 * swing
    sizes = {"min_swing": swing, "min_speed": speed, "max_speed": speed}
    return TINY | sizes | {"high": swing}


def sequence(part: dict[str, Any], parts: int) -> dict[str, Any]:
    """Return a waveform several times over."""
    return {"kind": "sequence", "parts": ({"duration_s": 60.0, "waveform": part},) * parts}


@pytest.mark.parametrize(
    "keys",
    [
        wiggle(0.01),
        {"kind": "sum", "parts": (staircase(9000), staircase(9000))},
        sequence(wiggle(0.01), 3),
    ],
)
def test_too_many_points_are_refused(keys: dict[str, Any]) -> None:
    """A path is not even drawn to its end: it could have 17 million points."""
    with pytest.raises(WaveformCostError, match=rf"at most {MAX_POINTS} .*larger min_swing"):
        pack_waveforms({"x": config(keys)}, 86_400.0)


@pytest.mark.parametrize(
    "keys", [{"kind": "sum", "parts": (multisine(64),) * 3}, sequence(multisine(3), 43)]
)
def test_too_many_terms_are_refused(keys: dict[str, Any]) -> None:
    """Each of them would cost time in every cycle."""
    with pytest.raises(WaveformCostError, match=f"at most {MAX_TERMS} in all"):
        pack_waveforms({"x": config(keys)}, 60.0)


def test_axes_share_the_limit() -> None:
    """The request is the unit, because the loop takes it as a whole."""
    waveform = config(staircase(9000))
    with pytest.raises(WaveformCostError):
        pack_waveforms({"x": waveform, "y": waveform}, 1.0)


def test_parts_that_last_longer_than_the_request_are_drawn_no_further() -> None:
    """Only what will be evaluated counts."""
    packed = pack_waveforms({"x": config(sequence(wiggle(0.01), 3))}, 10.0)

    assert all(len(part["levels"]) < 8 * 2100 for part in packed["x"]["parts"])
