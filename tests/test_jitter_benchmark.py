"""The parts of `benchmarks.jitter` that do not measure."""

from pathlib import Path
from unittest.mock import Mock

import pytest

from benchmarks.jitter.__main__ import Rounds
from benchmarks.jitter.contenders import Pacing, compile_floor, cyclictest
from benchmarks.jitter.stage import Stage
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create

PACING = Pacing(1000.0, 1, 60, 0, 40_000)


def test_steps_that_were_not_obtained_are_noted(tmp_path: Path) -> None:
    """The notes have the real-time steps of the loop's report, which also has its devices."""
    shared = create(tmp_path / "loop.map", Layout(("x",), 64, 1_000_000))
    steps = [{"name": "memory", "ok": False}, {"name": "processor", "ok": True}]
    shared.set_report({"steps": steps, "devices": [{"name": "rig"}]})
    stage, rounds = Stage(Mock(), shared), Rounds(1000.0)

    rounds._note({"requests": 200.0}, stage.counters, stage.report)  # noqa: SLF001 - its only use

    assert rounds.notes[0] == "load in the last round: requests 200"
    assert rounds.notes[2] == "not obtained: memory"


def test_machine_without_cyclictest_is_measured_without_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table says what to install."""
    monkeypatch.setenv("PATH", "")

    assert cyclictest(PACING) is None
    Rounds(1000.0).print()
    assert "no cyclictest: install the package rt-tests" in capsys.readouterr().out


def test_machine_without_a_compiler_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the floor there is nothing to compare with."""
    monkeypatch.setenv("PATH", "")

    with pytest.raises(SystemExit, match="install gcc"):
        compile_floor(tmp_path)
