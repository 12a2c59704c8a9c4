"""How fast a waveform may be for a loop."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from piezod.config.frequencies import coarse, too_fast
from piezod.config.waveforms.combined import WaveformConfig

ADAPTER: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)


def waveform(kind: str, frequency_hz: float) -> WaveformConfig:
    """Return a waveform of a kind whose highest frequency is given."""
    sine = {"kind": "sine", "low": 0, "high": 1, "frequency_hz": frequency_hz}
    constant = {"kind": "setpoint", "level": 0}
    component = {"amplitude": 1, "frequency_hz": frequency_hz}
    slow = {"amplitude": 1, "frequency_hz": 0.1}
    raw = {
        "sine": sine,
        "triangle": {**sine, "kind": "triangle"},
        "multisine": {"kind": "multisine", "low": 0, "components": (slow, component)},
        "sum": {"kind": "sum", "parts": (constant, sine)},
        "sequence": {
            "kind": "sequence",
            "parts": (
                {"duration_s": 1, "waveform": constant},
                {"duration_s": 1, "waveform": sine},
            ),
        },
    }
    return ADAPTER.validate_python(raw[kind])


@pytest.mark.parametrize("kind", ["sine", "triangle", "multisine", "sum", "sequence"])
def test_half_of_the_rate_is_refused(kind: str) -> None:
    """From half of the rate on a waveform is refused, wherever its sine stands."""
    assert too_fast(waveform(kind, 49.9).highest_hz(), 100.0) == ""
    assert too_fast(waveform(kind, 50.0).highest_hz(), 100.0) == (
        "too fast for the loop (got 50 Hz), allowed: below 50 Hz, half of rate_hz; a tenth, 10 Hz, "
        "gives a smooth motion"
    )


def test_waveforms_without_a_frequency_are_never_too_fast() -> None:
    """A setpoint has no frequency."""
    constant = ADAPTER.validate_python({"kind": "setpoint", "level": 1})

    assert too_fast(constant.highest_hz(), 1.0) == ""
    assert list(coarse({"x": constant}, 1.0)) == []


@pytest.mark.parametrize("frequency_hz", [12.0, 25.0, 40.0])
def test_told_step_and_phase_are_those_of_the_staircase(frequency_hz: float) -> None:
    """Above a tenth of the rate, largest step and mean lag of a held sine are in the warning."""
    rate_hz = 100.0
    assert list(coarse({"x": waveform("sine", 10.0)}, rate_hz)) == []
    (warning,) = coarse({"x": waveform("sine", frequency_hz)}, rate_hz)

    # A sine with a swing of 1, and the same one period of the loop later, from any instant on.
    t_s = np.linspace(0.0, 1.0 / frequency_hz, 20_001)
    steps = np.cos(2 * np.pi * frequency_hz * (t_s + 1.0 / rate_hz)) - np.cos(
        2 * np.pi * frequency_hz * t_s
    )
    half_period_deg = 360.0 * frequency_hz * 0.5 / rate_hz
    assert f"up to {50.0 * np.max(np.abs(steps)):.0f} % of the swing" in warning
    assert f"off by {half_period_deg:.2g}° on average" in warning
    assert warning.startswith(f"axis x: {frequency_hz:g} Hz is more than a tenth of the rate")
