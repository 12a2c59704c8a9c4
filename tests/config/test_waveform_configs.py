"""Waveforms in a configuration: their rules, their bounds, and points from files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.files import MAX_POINTS, read_points
from piezod.config.waveforms.combined import KINDS, Sequence, Sum
from piezod.config.waveforms.paths import Csv, Reversals, Staircase
from piezod.config.waveforms.shapes import Multisine, Setpoint, Sine

ProblemsOf = Callable[..., list[str]]

COMMAND = "{kind: triangle, low: 0, high: 25, frequency_hz: 0.5}"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (
            "{kind: sine, low: 3, high: 3, frequency_hz: 1}",
            "23:44: cases[0].command_um.high: must be above low (got 3, low is 3)",
        ),
        (
            "{kind: sine, low: 0, high: 3, frequency_hz: 0}",
            "23:61: cases[0].command_um.frequency_hz: out of range (got 0), allowed range 0.0001",
        ),
        (
            "{kind: sine, low: 0, high: 3, frequency_hz: 1, envelope: {kind: modulated, depth: 2,"
            " frequency_hz: 1}}",
            "23:99: cases[0].command_um.envelope.depth: out of range (got 2)",
        ),
        (
            "{kind: sine, low: 0, high: 3, frequency_hz: 1, anchor: high}",
            "23:72: cases[0].command_um.anchor: unknown value (got 'high'), allowed: low, middle",
        ),
        (
            "{kind: reversals, low: 0, high: 3, min_swing: 4, min_speed: 1, max_speed: 2, seed: 1}",
            "23:63: cases[0].command_um.min_swing: longer than the range (got 4), allowed: at",
        ),
        (
            "{kind: reversals, low: 0, high: 3, min_swing: 1, min_speed: 3, max_speed: 2, seed: 1}",
            "23:91: cases[0].command_um.max_speed: below min_speed (got 2), allowed: at least 3",
        ),
        (
            "{kind: reversals, low: 0, high: 3, min_swing: 1, min_speed: 3, max_speed: 201,"
            " seed: 1}",
            "23:91: cases[0].command_um.max_speed: more than 200 times min_swing per s (got 201)",
        ),
        (
            "{kind: sum, parts: [{kind: setpoint, level: 1}]}",
            "23:36: cases[0].command_um.parts: too few entries (got 1)",
        ),
        (
            "{kind: sum, parts: [{kind: setpoint, level: 1}, {kind: sum, parts: []}]}",
            "23:72: cases[0].command_um.parts[1].kind: unknown value (got 'sum'), allowed: "
            + ", ".join(kind for kind in KINDS if kind not in {"sum", "sequence"}),
        ),
        (
            "{kind: points, points: [[0, 1], [0, 2]]}",
            "23:49: cases[0].command_um.points[1]: must be later than the point before it (got 0",
        ),
        (
            "{kind: csv, path: none.csv, column: command_um}",
            "23:35: cases[0].command_um.path: no such file in {folder} (got 'none.csv')",
        ),
        (
            "{kind: csv, path: " + "a" * 300 + ", column: command_um}",
            "23:35: cases[0].command_um.path: no such file in {folder} (got '" + "a" * 39 + "…)",
        ),
        (
            "{kind: csv, path: 7, column: command_um}",
            "23:35: cases[0].command_um.path: must be the path of a file (got 7)",
        ),
    ],
)
def test_rules(problems_of: ProblemsOf, tmp_path: Path, command: str, expected: str) -> None:
    """An invalid waveform is refused at the place of the error."""
    expected = expected.replace("{folder}", str(tmp_path))

    (problem,) = problems_of((COMMAND, command))

    assert problem.startswith(f"test.yaml:{expected}")


@pytest.mark.parametrize(
    ("waveform", "expected"),
    [
        (Setpoint(kind="setpoint", level=3), (3.0, 3.0)),
        (Sine(kind="sine", low=-1, high=2, frequency_hz=1), (-1.0, 2.0)),
        (Staircase(kind="staircase", levels=(2.0, 5.0, -1.0), dwell_s=1), (-1.0, 5.0)),
    ],
)
def test_bounds_of_single_waveforms(
    waveform: Setpoint | Sine | Staircase, expected: tuple[float, float]
) -> None:
    """Bounds are the lowest and the highest value."""
    assert expected == waveform.bounds()


def test_bounds_of_combinations() -> None:
    """Bounds of a sum add up; those of a sequence enclose its parts."""
    sines = Multisine.model_validate(
        {
            "kind": "multisine",
            "low": 1,
            "components": (
                {"amplitude": 2, "frequency_hz": 1},
                {"amplitude": 3, "frequency_hz": 2},
            ),
        }
    )
    path = Reversals(
        kind="reversals", low=-4, high=4, min_swing=1, min_speed=1, max_speed=2, seed=1
    )
    total = Sum(kind="sum", parts=(sines, path))
    sequence = Sequence.model_validate(
        {
            "kind": "sequence",
            "parts": (
                {"duration_s": 1, "waveform": sines},
                {"duration_s": 1, "waveform": path},
            ),
        }
    )

    assert (
        sines.bounds(),
        total.bounds(),
        sequence.bounds(),
    ) == ((1.0, 11.0), (-3.0, 15.0), (-4.0, 11.0))


def test_points_come_from_a_file_beside_the_experiment(
    load: Callable[..., ExperimentConfig], tmp_path: Path
) -> None:
    """A CSV path is relative to the experiment file, its columns are found by name."""
    (tmp_path / "w.csv").write_text("t_s,drive_v, command_um\n0,9, 1.5\r\n0.5,9,3e0\n\n \n")
    experiment = load((COMMAND, "{kind: csv, path: w.csv, column: command_um}"))

    (waveform,) = experiment.cases[0].commands(["x"]).values()
    assert isinstance(waveform, Csv)
    assert waveform.line() == ((0.0, 1.5), (0.5, 3.0))
    assert waveform.bounds() == (1.5, 3.0)


def test_problems_of_a_file_are_told_at_its_path(problems_of: ProblemsOf, tmp_path: Path) -> None:
    """An error in the CSV file is reported with its line, at the key that names the file."""
    path = tmp_path / "w.csv"
    path.write_text("t_s,command_um\n0,1\n1,1e7\n")

    assert [
        f"test.yaml:23:35: cases[0].command_um.path: {path}:3: must be a number (got 1e+07), "
        "allowed range -1000000 to 1000000"
    ] == problems_of((COMMAND, "{kind: csv, path: w.csv, column: command_um}"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ":1: the file is empty"),
        ("t,command_um\n0,1\n1,2\n", ": which column is the time?"),
        ("t_s,command\n0,1\n", ": no column 'command_um'; the file has 't_s' (s), 'command'"),
        ("t_s,command_um\n", ":1: there are no rows of numbers"),
        ("t_s,command_um\n0,1\n1\n2,3\n", ":3: the row has 1 field"),
        ("t_s,command_um\n0,1\n1,2,5\n2,3\n", ":3: the row has 3 fields"),
        ("t_s,command_um\n0,1\n1,\n", ":3: the row has an empty cell"),
        ("t_s,command_um\n0,1\n1,1_0\n2,3\n", ":3: command_um is '1_0'"),
        ("t_s,command_um\n0,1\n1,0x10\n2,3\n", ":3: command_um is '0x10'"),
        ("t_s,command_um\n0,1\n\n1,2\n2,3\n", ":3: the row has 0 fields"),
        ("t_s,u,command_um,command_um\n0,1,2,3\n", ": column 'command_um' appears 2 times"),
        ("t_s,command_um\r\n0,1\r1,x\r2,3", ":3: command_um is 'x'"),
        ("t_s,command_um\n0,-1e7\n", ":2: must be a number (got -1e+07), allowed range -1000000"),
        ("t_s,command_um\n0,1\n0,2\n", ":3: time must grow by at least 1e-06 s (got 0)"),
        ("t_s,command_um\n1,1\n0,2\n", ":3: time must grow by at least 1e-06 s (got 0)"),
    ],
)
def test_csv_refusals(tmp_path: Path, text: str, expected: str) -> None:
    """An invalid file is refused with the line of the first error."""
    path = tmp_path / "w.csv"
    path.write_text(text, encoding="utf-8", newline="")

    with pytest.raises(ValueError, match=r"w\.csv") as caught:
        read_points(path, "command_um")
    assert str(caught.value).startswith(f"{path}{expected}")


def test_points_come_from_other_formats(tmp_path: Path) -> None:
    """Time and value get the units of the model, whatever the file has."""
    np.savez(tmp_path / "w.npz", time_ms=[0.0, 500.0], x_nm=[1500.0, 3000.0])
    (tmp_path / "w.csv").write_text("Zeit (s);x_um\n0,0;1,5\n0,5;3,0\n")

    assert read_points(tmp_path / "w.npz", "x_nm") == ((0.0, 1.5), (0.5, 3.0))
    assert read_points(tmp_path / "w.csv", "x_um") == ((0.0, 1.5), (0.5, 3.0))


def test_file_of_another_kind_is_no_waveform(tmp_path: Path) -> None:
    """A picture is refused, and a missing file too."""
    (tmp_path / "w.csv").write_bytes(b"\x89PNG\r\n\x1a\n")

    with pytest.raises(ValueError, match="a PNG picture"):
        read_points(tmp_path / "w.csv", "command_um")
    with pytest.raises(ValueError, match=r"none\.csv cannot be read"):
        read_points(tmp_path / "none.csv", "command_um")


def test_csv_of_endless_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of points is limited."""
    monkeypatch.setattr("piezod.config.files.MAX_POINTS", 2)
    path = tmp_path / "w.csv"
    path.write_text("t_s,command_um\n0,1\n1,2\n2,3\n")

    with pytest.raises(ValueError, match=r"w\.csv:4: too many points, allowed: at most 2"):
        read_points(path, "command_um")
    assert MAX_POINTS >= 1_000_000
