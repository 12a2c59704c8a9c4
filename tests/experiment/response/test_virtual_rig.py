"""The response of the simulated rig: its mode, delay and gain, against the parameters."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from piezod.errors import DataError
from piezod.experiment.response.plan import Wanted
from piezod.experiment.response.recorded import response_of_file
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from piezod.hysteresis.memory import FloatArray
from piezod.plant.parameters import StageParameters
from piezod.records.csv_file import write_csv
from piezod.records.response_record import ResponseRecord
from tests.conftest import Figure
from tests.experiment.response_rig import Load, measure, text_of, true_parameters

QUICK = Wanted(low_hz=20.0, high_hz=1800.0, periods=6)


def mode_of(record: ResponseRecord) -> tuple[float, float]:
    """Return frequency in Hz and damping of the only mode."""
    ((frequency_hz, damping),) = [
        (mode.frequency_hz, mode.damping)
        for mode in record.fit.model.resonances
        if mode.damping < 0.5
    ]
    return frequency_hz, damping


def told(figure: Figure, name: str, found: tuple[float, float], true: StageParameters) -> None:
    """Note a found mode beside the true one."""
    figure(
        f"response of {name}: {found[0]:.2f} Hz, damping {found[1]:.4f}; "
        f"true {true.mode_hz:.2f} Hz, {true.mode_damping:.4f}"
    )


@pytest.mark.parametrize("rate_hz", [5000.0, pytest.param(10_000.0, marks=pytest.mark.stress)])
def test_mode_and_delay_are_found(load: Load, figure: Figure, rate_hz: float) -> None:
    """The mode is found within 0.5 %, behind the filter; the phase has the true delay."""
    true = true_parameters()

    record = measure(load, rate_hz, QUICK)

    frequency_hz, damping = mode_of(record)
    told(figure, f"stack at {rate_hz:g} Hz", (frequency_hz, damping), true.stage)
    assert frequency_hz == pytest.approx(true.stage.mode_hz, rel=0.005)
    assert damping == pytest.approx(true.stage.mode_damping, rel=0.1)
    # At low frequencies only the sum of all delays counts: that of each part is known.
    model, f = record.fit.model, np.array([20.0])
    lag_s = -np.angle(model.at(f))[0] / (2.0 * np.pi * f[0])
    parts_s = (
        true.sensor.delay_s
        + np.sqrt(2.0) / (2.0 * np.pi * true.sensor.antialias_hz)
        + 2.0 * true.stage.mode_damping / (2.0 * np.pi * true.stage.mode_hz)
        + 1.0 / (2.0 * np.pi * true.amplifier.bandwidth_hz)
        + 1.0 / (2.0 * np.pi * true.sensor.bandwidth_hz)
    )
    assert lag_s == pytest.approx(parts_s, rel=0.1)
    (about,) = record.about
    assert about.step is not None
    assert about.step.steps == 8
    assert np.max(about.step.answer) > 1.1  # it rings


@pytest.mark.stress
def test_gain_differs_between_voltages_and_the_mode_does_not(load: Load, figure: Figure) -> None:
    """Two voltages give two gains and one mode; without a filter it is found, too."""
    true = true_parameters("no-antialias")
    wanted = Wanted((50.0, 100.0), low_hz=5.0, periods=8)

    record = measure(load, 4000.0, wanted, "no-antialias")

    told(figure, "no-antialias", mode_of(record), true.stage)
    assert mode_of(record)[0] == pytest.approx(true.stage.mode_hz, rel=0.005)
    first, second = record.fit.gains
    assert abs(first[0] - second[0]) > 3.0 * np.hypot(first[1], second[1])
    assert all(0.08 < gain < 0.2 for gain, _ in record.fit.gains)


@pytest.mark.stress
def test_slow_loop_shows_a_delay_and_no_mode(load: Load) -> None:
    """At 200 Hz each voltage has its effect in the next sample, and no more is known."""
    record = measure(load, 200.0, Wanted(low_hz=2.0, periods=8))

    assert record.fit.model.resonances == ()
    # A voltage shows in the next sample: half a period after the middle of its hold.
    assert record.fit.model.delay_s == pytest.approx(0.5 / 200.0, abs=0.2e-3)


def test_mode_above_half_the_rate_is_not_claimed(load: Load) -> None:
    """At 1 kHz the mode is folded to 193 Hz; it is told, and not taken for a mode there."""
    record = measure(load, 1000.0, Wanted(low_hz=5.0, periods=8))

    assert record.fit.model.resonances == ()
    assert "above half of the rate, folded below it" in record.warnings[0]


def test_noise_is_refused_with_a_remedy(load: Load) -> None:
    """A sensor that shows only noise gives no model."""

    def noise(columns: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        values = np.random.default_rng(1).standard_normal(columns["drive_v"].size)
        return {**columns, "position_um": values}

    with pytest.raises(DataError, match=r"axis x: no model: 0 of \d+ lines .*; a remedy"):
        measure(load, 1000.0, Wanted(low_hz=5.0, periods=6), change=noise)


def test_record_without_the_drive_is_refused(load: Load) -> None:
    """A record that ends too early is not evaluated."""

    def half(columns: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        return {name: column[: column.size // 2] for name, column in columns.items()}

    with pytest.raises(DataError, match="does not contain the whole drive"):
        measure(load, 1000.0, Wanted(low_hz=5.0, periods=6), change=half)


@pytest.mark.stress
def test_recording_of_a_movement_gives_the_mode(load: Load, tmp_path: Path) -> None:
    """A random drive, recorded, gives the mode by averages over the record."""
    rate_hz, duration_s = 3000.0, 9.0
    levels_v = 75.0 + np.random.default_rng(1).uniform(-2.0, 2.0, round(duration_s * rate_hz) + 1)
    with opened(load(text_of(rate_hz)), lambda _cycles: None) as stage:
        stage.open_loop([lambda t_s: 75.0 * min(t_s / 0.1, 1.0)], 1.0)
        drive_v = [lambda t_s: float(levels_v[round(t_s * rate_hz)])]
        (trace,) = stage.open_loop(drive_v, duration_s)
    path = tmp_path / "r.csv"
    columns = {"drive_v": trace[:, IN_FORCE_V], "position_um": trace[:, POSITION_UM]}
    write_csv(path, {"t_s": np.arange(trace.shape[0]) / rate_hz, **columns})

    record = response_of_file(path, None)

    true = true_parameters().stage
    assert (record.axis, record.method) == ("x", "recording")
    assert mode_of(record) == pytest.approx((true.mode_hz, true.mode_damping), rel=0.1)
    assert mode_of(record)[0] == pytest.approx(true.mode_hz, rel=0.01)


def test_recording_of_one_frequency_is_refused(tmp_path: Path) -> None:
    """A sine excites one line; the file and what to do are named."""
    t_s = np.arange(20_000) / 1000.0
    drive_v = 75.0 + 3.0 * np.sin(2.0 * np.pi * 5.0 * t_s)
    position_um = 0.1 * drive_v + 0.01 * np.random.default_rng(1).standard_normal(t_s.size)
    path = tmp_path / "sine.csv"
    write_csv(path, {"t_s": t_s, "drive_v": drive_v, "position_um": position_um})

    with pytest.raises(DataError, match=r"sine\.csv: axis x: no model: .*more frequencies"):
        response_of_file(path, None)
