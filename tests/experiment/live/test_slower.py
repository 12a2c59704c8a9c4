"""Tests of commands that are slowed down for a slow loop."""

import re
from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.config.waveforms import Points
from piezod.devices import registry
from piezod.errors import DataError
from piezod.experiment.live.slower import slow_enough
from tests.experiment.virtual.test_qiu import QIU


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_a_cycle_moves_what_it_may_and_no_more(rate_hz: float) -> None:
    """Each case of the paper comes within a tenth of a percent of its range."""
    config = load_experiment(QIU, registry)
    slow, told = slow_enough(config, rate_hz, 0.1)
    steps = [re.search(r"at most ([0-9.]+) %", sentence) for sentence in told]

    assert len(slow.cases) == len(told) == 3
    for step in steps:
        assert step is not None
        assert 0.05 < float(step[1]) <= 0.1005  # a random path is another one when it is slower


def test_the_frequencies_are_told() -> None:
    """Half a hertz at 1 kHz moves 0.157 % a cycle: it becomes 0.318 Hz."""
    _, told = slow_enough(load_experiment(QIU, registry), 1000.0, 0.1)

    assert re.search(r"slowed down 1\.5\d times, its frequencies are 0\.3\d+ Hz", told[0])


def test_what_is_slow_enough_stays() -> None:
    """Nothing is made faster."""
    config = load_experiment(QIU, registry)
    slow, told = slow_enough(config, 1000.0, 50.0)

    assert slow.cases == config.cases
    assert "slowed down 1 times" in told[0]


def test_points_get_later() -> None:
    """10 µm in a second at 1 kHz are 0.1 % a cycle: for half of that they take two."""
    config = load_experiment(QIU, registry)
    points = {"kind": "points", "points": ((0.0, 0.0), (1.0, 10.0), (20.0, 10.0))}
    case = config.cases[0].model_dump() | {"command_um": points}
    of_points = type(config.cases[0]).model_validate(case)
    slow, _ = slow_enough(config.model_copy(update={"cases": (of_points,)}), 1000.0, 0.05)

    assert isinstance(slow.cases[0].command_um, Points)
    assert slow.cases[0].command_um.points[1][0] == pytest.approx(2.0, rel=0.01)


def test_the_times_of_a_file_are_its_own(tmp_path: Path) -> None:
    """A CSV command is refused, by the name of its case."""
    file = tmp_path / "command.csv"
    file.write_text("t_s,x\n0,0\n20,10\n", encoding="utf-8")
    config = load_experiment(QIU, registry)
    command = {"kind": "csv", "path": file, "column": "x"}
    case = config.cases[0].model_dump() | {"command_um": command}
    of_file = type(config.cases[0]).model_validate(case)

    with pytest.raises(DataError, match="case 1: the times of a CSV file"):
        slow_enough(config.model_copy(update={"cases": (of_file,)}), 1000.0, 0.05)
