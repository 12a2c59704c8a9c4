"""A stage on a player board, from the cables to a learned wave, through its compiled firmware."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from benchmarks.bus.example import EXAMPLES, at_port, placed
from tests.conftest import Figure
from tests.daemon.daemons import Daemon
from tests.drivers.bus.bench import emulated
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.system.test_bus_demo import condition, moved

pytestmark = [needs_board, pytest.mark.stress, pytest.mark.timeout(3600)]
RATE_HZ = 20


def configured(folder: Path, where: list[str]) -> Path:
    """Write the configuration of a stage on a board."""
    document = placed("board", where, at_port, RATE_HZ)
    document["devices"]["board"]["options"] |= {"timeout_ms": 200, "watchdog_ms": 10_000}
    document["loop"] = {"cpu": min(os.sched_getaffinity(0))}  # other tests use the last one
    response = EXAMPLES.parent / "responses" / "simulated-stack.yaml"
    document["axes"]["x"]["response"] = str(response)
    path = folder / "board.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def test_a_board_is_commissioned(tmp_path: Path) -> None:
    """`piezod commission` measures travel, delay and first mode, and leaves the safe voltage."""
    trace = tmp_path / "trace.csv"
    with emulated("board", arguments=("--trace", str(trace))) as devices:
        config = configured(tmp_path, devices.where)
        done = subprocess.run(
            [sys.executable, "-m", "piezod", "commission", str(config), "--yes"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert float(trace.read_text(encoding="ascii").splitlines()[-1].split(",")[3]) == 0.0


def test_a_board_is_identified_driven_and_played(tmp_path: Path, figure: Figure) -> None:
    """A model is identified on the running stage; feedforward, adaptive and a play use it."""
    wave = tmp_path / "wave.yaml"
    command_um = {"kind": "sine", "low": 8, "high": 16, "frequency_hz": 50}
    wave.write_text(yaml.safe_dump({"command_um": command_um}), encoding="utf-8")
    with emulated("board") as devices, Daemon(configured(tmp_path, devices.where)) as daemon:
        daemon.up()
        model = "--out", str(tmp_path / "model.yaml")
        identified = daemon.command("identify", "--live", "--adopt", *model, "--json")
        assert identified.returncode == 0, identified.stdout + identified.stderr
        for mode in ("feedforward", "adaptive"):
            if mode == "adaptive":
                condition(daemon)
            assert daemon.command("mode", mode).returncode == 0
            error_um = abs(moved(daemon)["axes"]["x"]["position_um"] - 12.5)
            figure(f"player board, {mode}: {error_um:.3f} µm from 12.5 µm")
            assert error_um < 0.3
            daemon.command("disarm")
            daemon.until("SAFE")
        times = "--interval-us", "100", "--settle-s", "1", "--record-s", "0.2", "--learn", "4"
        played = daemon.command("play", str(wave), *times, "--json")
        assert played.returncode == 0, played.stdout + played.stderr
    figure(f"player board, sine 50 Hz: {json.loads(played.stdout)['stopped']}")
