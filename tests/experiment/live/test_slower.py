"""Tests of commands that are slowed down for a slow loop."""

import re
from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.config.waveforms.paths import Points
from piezod.devices import registry
from piezod.errors import DataError
from piezod.experiment.live.slower import slow_enough
from tests.experiment.virtual.test_qiu import QIU


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_cycle_moves_by_the_largest_step(rate_hz: float) -> None:
    """Each case of the paper reaches a tenth of a percent of its range."""
    config = load_experiment(QIU, registry)
    slow, notes = slow_enough(config, rate_hz, 0.1)
    steps = [re.search(r"at most ([0-9.]+) %", sentence) for sentence in notes]

    assert len(slow.cases) == len(notes) == 3
    for step in steps:
        assert step is not None
        assert 0.05 < float(step[1]) <= 0.1005  # a random path is another one when it is slower


def test_frequencies_are_reported() -> None:
    """0.5 Hz at 1 kHz moves 0.157 % per cycle: it becomes 0.318 Hz."""
    _, notes = slow_enough(load_experiment(QIU, registry), 1000.0, 0.1)

    assert re.search(r"slowed down 1\.5\d times, to at most 0\.3\d+ Hz", notes[0])


def test_slow_command_is_unchanged() -> None:
    """No command is made faster."""
    config = load_experiment(QIU, registry)
    slow, notes = slow_enough(config, 1000.0, 50.0)

    assert slow.cases == config.cases
    assert "slowed down 1 times" in notes[0]


def test_points_are_stretched_in_time() -> None:
    """10 µm in a second at 1 kHz is 0.1 % per cycle: for 0.05 % it takes two seconds."""
    config = load_experiment(QIU, registry)
    points = {"kind": "points", "points": ((0.0, 0.0), (1.0, 10.0), (20.0, 10.0))}
    case = config.cases[0].model_dump() | {"command_um": points}
    of_points = type(config.cases[0]).model_validate(case)
    slow, _ = slow_enough(config.model_copy(update={"cases": (of_points,)}), 1000.0, 0.05)

    assert isinstance(slow.cases[0].command_um, Points)
    assert slow.cases[0].command_um.points[1][0] == pytest.approx(2.0, rel=0.01)


def test_command_from_a_file_is_refused(tmp_path: Path) -> None:
    """The times of a CSV file are fixed; the error names the case."""
    file = tmp_path / "command.csv"
    file.write_text("t_s,x\n0,0\n20,10\n", encoding="utf-8")
    config = load_experiment(QIU, registry)
    command = {"kind": "csv", "path": file, "column": "x"}
    case = config.cases[0].model_dump() | {"command_um": command}
    of_file = type(config.cases[0]).model_validate(case)

    with pytest.raises(DataError, match="case 1: the times of a CSV file"):
        slow_enough(config.model_copy(update={"cases": (of_file,)}), 1000.0, 0.05)
