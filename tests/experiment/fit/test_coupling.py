"""The coupling of axes, from a recording that moves one after the other."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.config.coupling_file import CouplingFile
from piezod.errors import DataError
from piezod.experiment.fit.coupling import couplings_in
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry

RATE_HZ = 200.0
PATH = Path("record.h5")


def made_up(
    shares: tuple[float, float] = (0.03, -0.02),
    *,
    together: bool = False,
    lag_s: float = 0.0,
    seed: int = 1,
) -> RecordedTelemetry:
    """Return a recording of 20 s: a swings, then b, or both at once.

    Args:
        shares: How far a moves b, and b moves a.
        together: Whether both swing all the time.
        lag_s: How much later the other axis follows.
        seed: Seed of the noise.
    """
    t_s = np.arange(4000) / RATE_HZ

    def swing_um(begin_s: float, shift_s: float) -> Any:
        since_s = np.clip(t_s - begin_s - shift_s, 0.0, 8.0)
        return 10.0 * (1.0 - np.cos(np.pi * since_s))

    noise = np.random.default_rng(seed).normal(0.0, 0.002, (2, t_s.size))
    starts_s = {"a": 1.0, "b": 1.0 if together else 10.0}
    own = {name: swing_um(begin_s, 0.0) for name, begin_s in starts_s.items()}
    late = {name: swing_um(begin_s, lag_s) for name, begin_s in starts_s.items()}
    shown = {"a": own["a"] + shares[1] * late["b"], "b": own["b"] + shares[0] * late["a"]}
    axes = {
        name: {"position_um": shown[name] + noise[i], "in_force_v": 5.0 * own[name]}
        for i, name in enumerate("ab")
    }
    header = TelemetryHeader("", ("a", "b"), RATE_HZ, "", 0)
    return RecordedTelemetry(header, 0, np.zeros((0, 2), np.int64), {"t_s": t_s}, axes, {})


def test_each_share_is_found() -> None:
    """Both ways are found, to a small part of a percent, and nothing is left."""
    found = couplings_in(made_up(), PATH)
    by_pair = {(pair.moving, pair.resting): pair for pair in found.pairs}
    assert by_pair["a", "b"].share == pytest.approx(0.03, abs=2e-4)
    assert by_pair["b", "a"].share == pytest.approx(-0.02, abs=2e-4)
    assert by_pair["a", "b"].uncertainty < 1e-3
    assert by_pair["a", "b"].before_um == pytest.approx(0.6, abs=0.02)
    assert by_pair["a", "b"].after_um < 0.02
    assert all(pair.lag_s == 0.0 for pair in found.pairs)


def test_the_file_is_that_of_the_shares() -> None:
    """The file has for each axis what the other one does to it."""
    found = couplings_in(made_up(), PATH)
    file = found.file("now")
    assert file == CouplingFile.model_validate(file.model_dump())
    assert file.shares["b"]["a"] == pytest.approx(0.03, abs=2e-4)
    assert file.source == "record.h5"


@pytest.mark.parametrize("lag_s", [0.02, 0.003])
def test_a_lag_is_found(lag_s: float) -> None:
    """An axis that follows later is told, also by less than a cycle, and the file has the lag."""
    found = couplings_in(made_up(lag_s=lag_s), PATH)
    assert [pair.lag_s for pair in found.pairs] == pytest.approx([lag_s, lag_s], abs=0.001)
    assert all(pair.lag_uncertainty_s < 0.002 for pair in found.pairs)
    file = found.file("now")
    assert file.lags_s["b"]["a"] == pytest.approx(lag_s, abs=0.001)
    assert file == CouplingFile.model_validate(file.model_dump())


def test_what_the_sensors_show_later_is_no_lag() -> None:
    """The delay of a sensor, and the instant at which it is read, are known."""
    record = made_up(lag_s=0.02)
    axes: dict[str, Any] = {"a": {}, "b": {"compensator": {"sensor_delay_s": 0.012}}}
    header = replace(record.header, notes={"configuration": json.dumps({"axes": axes})})
    record = replace(record, header=header)
    record.cycles["t_ns"] = np.round(record.cycles["t_s"] * 1e9)
    record.axes["b"]["sample_ns"] = record.cycles["t_ns"] - 8e6
    pair = next(pair for pair in couplings_in(record, PATH).pairs if pair.resting == "b")
    assert pair.lag_s == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_lag(seed: int) -> None:
    """Without a lag none is stored, whatever the noise."""
    found = couplings_in(made_up(seed=seed), PATH)
    assert found.file("now").lags_s == {}


def test_axes_that_move_together_are_refused() -> None:
    """Nobody can tell apart what two axes do at once."""
    with pytest.raises(DataError, match="axis a moves alone in 0 samples"):
        couplings_in(made_up(together=True), PATH)


def test_one_axis_is_not_enough() -> None:
    """Coupling needs two axes with sensors."""
    record = made_up()
    record.axes["b"]["position_um"][:] = np.nan
    with pytest.raises(DataError, match="got 1"):
        couplings_in(record, PATH)


def test_more_than_half_is_no_coupling() -> None:
    """Axes that move each other by more than half are wired or configured wrongly."""
    with pytest.raises(DataError, match="at most 50 %"):
        couplings_in(made_up((0.7, 0.0)), PATH)
