"""Tests of `piezod probe` and `piezod commission`, on a clock that nobody waits for."""

import json
import os
import re
import signal
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import pytest

from piezod.commission import bench
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from tests.cli.conftest import Command

SHIPPED = Path(__file__).parents[2] / "config" / "simulated.yaml"


@pytest.fixture(autouse=True)
def _nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "MonotonicClock", lambda: FakeClock(1_000_000_000))


@pytest.fixture
def config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a configuration in a folder of its own, as is what keeps others off its devices."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    path = folder / "stage.yaml"
    model = SHIPPED.parent / "models" / "simulated-stack.yaml"
    text = SHIPPED.read_text(encoding="utf-8").replace("models/simulated-stack.yaml", str(model))
    path.write_text(text, encoding="utf-8")
    return path


def test_probe_tells_who_is_there_and_moves_nothing(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Identity, readings and the rate that exchanges allow; no voltage is written."""
    written: list[object] = []
    monkeypatch.setattr(SimulatedRig, "write", lambda _rig, *values: written.append(values))
    outcome = piezod("probe", str(config))

    assert outcome.code == 0, outcome.err
    assert "piezod, simulated stack, seed 1" in outcome.out
    assert "Hz in the cycle" in outcome.out
    assert written == []


def test_probe_wiggles_after_a_yes(piezod: Command, config: Path) -> None:
    """It tells how far the stage moves for a volt."""
    outcome = piezod("probe", str(config), "--wiggle", "--yes", "--json")
    document = json.loads(outcome.out)

    assert 0.05 < document["wiggled"]["x"]["um_per_v"] < 0.2
    assert document["devices"]["rig"]["capabilities"]["read_back"] is True


def test_probe_says_which_device_is_absent(piezod: Command, config: Path) -> None:
    """It exits with 69."""
    text = config.read_text(encoding="utf-8")
    absent = "rig: {driver: emulated, options: {socket: nowhere.sock}}"
    config.write_text(text.replace("rig: {driver: simulated, options: {variant: stack}}", absent))
    outcome = piezod("probe", str(config))

    assert outcome.code == 69
    assert "device rig:" in outcome.err


def test_commission_leaves_a_sheet_and_a_configuration_that_runs(
    piezod: Command, config: Path, folder: Path
) -> None:
    """All steps are done, one after the other; the configuration passes `piezod check`."""
    outcome = piezod("commission", str(config), "--yes", "--json")
    document = json.loads(outcome.out)

    assert outcome.code == 0, outcome.err
    assert document["not_done"] == []
    assert re.search(r"first mode at 80[678] Hz", outcome.err)
    assert (folder / "x-commissioned" / "acceptance.html").exists()
    assert piezod("check", "x-commissioned/stage.yaml").code == 0


def test_commission_ends_with_a_no(
    piezod: Command, config: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was done until then is on the sheet, and nothing has moved."""
    monkeypatch.setattr("sys.stdin", StringIO("y\nn\n"))
    outcome = piezod("commission", str(config))

    assert outcome.code == 0, outcome.err
    sheet = (folder / "x-commissioned" / "acceptance.html").read_text(encoding="utf-8")
    assert "Not done: polarity, travel 10 %" in sheet
    assert not (folder / "x-commissioned" / "stage.yaml").exists()


def test_commission_of_an_axis_that_is_not_there(piezod: Command, config: Path) -> None:
    """It exits with 2 and names those that are."""
    outcome = piezod("commission", str(config), "--axis", "z")

    assert outcome.code == 2
    assert "known: x" in outcome.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_commission_goes_back_when_it_is_told_to_end(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """Even where it is told again on its way back; it exits with 130."""
    written: list[float] = []
    write = SimulatedRig.write

    def noting(rig: SimulatedRig, drive_v: Sequence[float], now_ns: int) -> bool:
        written.append(drive_v[0])
        if drive_v[0] > 30.0:
            os.kill(os.getpid(), number)
        return write(rig, drive_v, now_ns)

    monkeypatch.setattr(SimulatedRig, "write", noting)
    outcome = piezod("commission", str(config), "--yes")

    assert outcome.code == 130
    assert max(written) < 31.0
    assert written[-1] == pytest.approx(0.0, abs=0.01)
