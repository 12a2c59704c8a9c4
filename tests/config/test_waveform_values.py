"""Tests of each kind of waveform."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.waveform import Waveform

DURATION_S = 20.0
READER: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)


def waveform_of(kind: str, **keys: Any) -> Waveform:
    """Return a waveform from the keys of its configuration."""
    return READER.validate_python({"kind": kind, **keys}).built(DURATION_S)


def test_setpoint() -> None:
    """A setpoint has one value."""
    assert [waveform_of("setpoint", level=3).value(t_s) for t_s in (0.0, 7.0)] == [3.0, 3.0]


def test_sine() -> None:
    """A sine goes from low over the middle to high and back, in one period."""
    sine = waveform_of("sine", low=2, high=6, frequency_hz=0.5)

    assert [sine.value(t_s) for t_s in (0.0, 0.5, 1.0, 1.5, 2.0, 101.0)] == pytest.approx(
        [2.0, 4.0, 6.0, 4.0, 2.0, 6.0], abs=1e-12
    )
    assert (sine.value(0.0), sine.value(1.0), sine.value(2e6)) == (2.0, 6.0, 2.0)


def test_triangle() -> None:
    """A triangle consists of straight lines."""
    triangle = waveform_of("triangle", low=2, high=6, frequency_hz=0.5)

    assert [triangle.value(t_s) for t_s in (0.0, 0.25, 0.5, 1.0, 1.75, 2.0)] == pytest.approx(
        [2.0, 3.0, 4.0, 6.0, 3.0, 2.0], abs=1e-12
    )


def test_modulated_envelope() -> None:
    """A modulated swing starts at full size, is smallest after half a period, and repeats."""
    sine = waveform_of(
        "sine",
        low=1,
        high=11,
        frequency_hz=0.5,
        envelope={"kind": "modulated", "depth": 0.8, "frequency_hz": 0.5},
    )

    # At the crest of the sine the envelope is smallest, at its foot it is full.
    assert [sine.value(t_s) for t_s in (0.0, 1.0, 2.0, 3.0)] == pytest.approx([1.0, 3.0, 1.0, 3.0])
    assert sine.value(0.5) == pytest.approx(1 + 5 * 0.6)


def test_modulated_crests() -> None:
    """With a slow envelope each crest is as high as the envelope there."""
    triangle = waveform_of(
        "triangle",
        low=0,
        high=10,
        frequency_hz=1,
        envelope={"kind": "modulated", "depth": 0.5, "frequency_hz": 0.05},
    )
    crests = [triangle.value(0.5 + turn) for turn in range(20)]

    assert crests == pytest.approx(
        [10 - 2.5 * (1 - math.cos(math.tau * 0.05 * (0.5 + turn))) for turn in range(20)]
    )


def test_decaying_about_the_lowest() -> None:
    """A decaying swing that is anchored low reaches the lowest value in every period."""
    sine = waveform_of(
        "sine",
        low=1,
        high=11,
        frequency_hz=1,
        envelope={"kind": "decaying", "time_constant_s": 2, "final_fraction": 0.2},
    )

    assert [sine.value(float(turn)) for turn in range(5)] == [1.0] * 5
    assert [sine.value(turn + 0.5) for turn in range(3)] == pytest.approx(
        [1 + 10 * (0.2 + 0.8 * math.exp(-(turn + 0.5) / 2)) for turn in range(3)]
    )


def test_decaying_about_the_middle() -> None:
    """A decaying swing that is anchored in the middle ends in the middle."""
    sine = waveform_of(
        "sine",
        low=0,
        high=10,
        frequency_hz=1,
        anchor="middle",
        envelope={"kind": "decaying", "time_constant_s": 2},
    )

    assert sine.value(0.0) == 0.0
    assert sine.value(3.0) == pytest.approx(5 - 5 * math.exp(-3 / 2))
    assert sine.value(100.0) == pytest.approx(5.0)


@pytest.mark.parametrize(("from_hz", "to_hz"), [(1.0, 5.0), (5.0, 1.0), (2.0, 2.0)])
@pytest.mark.parametrize("sweep", ["linear", "logarithmic"])
def test_chirp(sweep: str, from_hz: float, to_hz: float) -> None:
    """Its phase is the integral of its frequency, which is constant after the sweep."""
    sweep_s = 8.0
    chirp = waveform_of(
        "chirp", low=2, high=6, from_hz=from_hz, to_hz=to_hz, sweep_s=sweep_s, sweep=sweep
    )

    def turns(t_s: float) -> float:
        t = np.linspace(0.0, t_s, 200_001)
        share = np.minimum(t / sweep_s, 1.0)
        by_factors = from_hz * (to_hz / from_hz) ** share
        hz = from_hz + (to_hz - from_hz) * share if sweep == "linear" else by_factors
        return float(np.trapezoid(hz, t))

    assert chirp.highest_hz == max(from_hz, to_hz)
    assert [chirp.value(t_s) for t_s in (0.0, 0.3, 4.0, 7.99, 8.0, 8.01, 19.3)] == pytest.approx(
        [4 - 2 * math.cos(math.tau * turns(t_s)) for t_s in (0.0, 0.3, 4.0, 7.99, 8.0, 8.01, 19.3)],
        abs=1e-5,
    )


def test_multisine() -> None:
    """Each sinusoid has its amplitude, frequency and phase."""
    sines = waveform_of(
        "multisine",
        low=1,
        components=(
            {"amplitude": 2, "frequency_hz": 0.5},
            {"amplitude": 3, "frequency_hz": 0.3, "phase_deg": 90},
        ),
    )
    times_s = (0.0, 0.7, 3.3, 19.9)

    assert [sines.value(t_s) for t_s in times_s] == pytest.approx(
        [
            6 - 2 * math.cos(math.tau * 0.5 * t_s) + 3 * math.sin(math.tau * 0.3 * t_s)
            for t_s in times_s
        ]
    )


def test_staircase() -> None:
    """A level lasts from its edge to the next one; the last level stays."""
    stairs = waveform_of("staircase", levels=(1.0, 5.0, 2.0), dwell_s=0.5)

    assert [stairs.value(t_s) for t_s in (0.0, 0.499, 0.5, 0.999, 1.0, 50.0)] == [
        1.0, 1.0, 5.0, 5.0, 2.0, 2.0,
    ]  # fmt: skip


def test_points_and_a_file_with_them_are_the_same_waveform(tmp_path: Any) -> None:
    """They are joined by straight lines; the first and the last value are held."""
    path = tmp_path / "w.csv"
    path.write_text("t_s,command_um\n1,2\n2,6\n4,-2\n")
    filed = waveform_of("csv", path=path, column="command_um")
    here = waveform_of("points", points=((1.0, 2.0), (2.0, 6.0), (4.0, -2.0)))

    times_s = (0.0, 1.0, 1.25, 2.0, 3.0, 4.0, 9.0)
    for points in (filed, here):
        values = [points.value(t_s) for t_s in times_s]
        assert values == [2.0, 2.0, 3.0, 6.0, 2.0, -2.0, -2.0]
    assert (here.low, here.high) == (filed.low, filed.high) == (-2.0, 6.0)


def test_csv_of_one_point(tmp_path: Any) -> None:
    """A single point is a setpoint."""
    path = tmp_path / "w.csv"
    path.write_text("t_s,drive_v\n1,2\n")
    points = waveform_of("csv", path=path, column="drive_v")

    assert [points.value(t_s) for t_s in (0.0, 1.0, 2.0)] == [2.0, 2.0, 2.0]


def test_sum() -> None:
    """A sum adds its parts."""
    total = waveform_of(
        "sum",
        parts=(
            {"kind": "setpoint", "level": 4},
            {"kind": "triangle", "low": -1, "high": 1, "frequency_hz": 1},
        ),
    )

    assert [total.value(t_s) for t_s in (0.0, 0.25, 0.5)] == [3.0, 4.0, 5.0]


def test_sequence() -> None:
    """Each part starts when the part before it ends; the last value stays."""
    parts = waveform_of(
        "sequence",
        parts=(
            {
                "duration_s": 2,
                "waveform": {"kind": "triangle", "low": 0, "high": 4, "frequency_hz": 0.5},
            },
            {
                "duration_s": 1,
                "waveform": {"kind": "triangle", "low": 0, "high": 8, "frequency_hz": 0.25},
            },
        ),
    )

    assert [parts.value(t_s) for t_s in (0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 8.0)] == [
        0.0, 4.0, 2.0, 0.0, 2.0, 4.0, 4.0,
    ]  # fmt: skip
