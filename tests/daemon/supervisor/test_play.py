"""A table that the simulated rig plays while a daemon runs it."""

import json
from math import pi, sin
from pathlib import Path

import pytest

from piezod.client import StageClient
from piezod.experiment.live.play import learn_waveform
from tests.daemon.conftest import StartDaemon

WAVE = "command_um: {kind: sine, low: 8, high: 16, frequency_hz: 50}\n"

POINTS, CYCLES, INTERVAL_S = 100, 4, 1e-4
TABLE_V = [40.0 + 30.0 * sin(2.0 * pi * k / POINTS) for k in range(POINTS)]


def test_table_is_played_and_its_record_is_served(rig_file: Path, start: StartDaemon) -> None:
    """The record has a sample for each point, and the stage is ready again."""
    daemon = start(rig_file)
    daemon.until("SAFE")
    before = daemon.ask("GET", "play")
    daemon.do("arm")
    daemon.do("play", drive_v=TABLE_V, interval_s=INTERVAL_S, cycles=CYCLES)
    daemon.until("READY")
    played = daemon.ask("GET", "play").json()
    position_um = played["position_um"][-POINTS:]

    assert before.status_code == 404
    assert played["failed"] == ""
    assert len(played["position_um"]) == POINTS * CYCLES
    assert max(position_um) - min(position_um) > 3.0


@pytest.mark.stress
def test_error_falls_from_pass_to_pass(rig_file: Path, start: StartDaemon) -> None:
    """`piezod play` learns on a running stage, stores the best table, and disarms the stage.

    The next play of the same waveform begins with that table; another waveform does not.
    """
    wave = rig_file.parent / "wave.yaml"
    wave.write_text(WAVE, encoding="utf-8")
    daemon = start(rig_file)
    daemon.until("SAFE")
    tables = rig_file.parent / "tables"
    brief = ("--settle-s", "0.2", "--record-s", "0.2", "--tables", str(tables), "--json")
    done = daemon.command("play", str(wave), "--learn", "2", *brief)
    assert done.returncode == 0, done.stderr
    learned = json.loads(done.stdout)
    errors_pct = [each["max_pct"] for each in learned["passes"]]
    again = daemon.command("play", str(wave), "--learn", "0", *brief)
    wave.write_text(WAVE.replace("16", "18"), encoding="utf-8")
    other = daemon.command("play", str(wave), "--learn", "0", *brief)

    assert errors_pct[2] < errors_pct[1] < errors_pct[0]
    assert learned["best"] == "pass 2"
    assert len(learned["table"]["period_v"]) == 400
    assert "begins with table_x_wave.yaml" in again.stderr
    (stored,) = json.loads(again.stdout)["passes"]
    assert stored["label"] == "stored table"
    assert stored["max_pct"] < errors_pct[0]
    assert "table_x_wave.yaml is not used, changed since: another waveform" in other.stderr
    assert daemon.status()["state"] == "SAFE"


@pytest.mark.stress
def test_program_learns_on_a_running_stage(rig_file: Path, start: StartDaemon) -> None:
    """`learn_waveform` measures the response, corrects the table, and disarms the stage."""
    daemon = start(rig_file)
    daemon.until("SAFE")
    command_um = {"kind": "sine", "low": 8, "high": 16, "frequency_hz": 50}
    with StageClient(socket=daemon.paths.api_socket) as stage:
        learned = learn_waveform(stage, {"command_um": command_um}, 1, settle_s=0.2, record_s=0.2)
        state = stage.status().state

    before, after = (each.measured.max_pct for each in learned.reports)
    assert after < 0.5 * before
    assert learned.best.label == "pass 1"
    assert state == "SAFE"
