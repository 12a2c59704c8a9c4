"""The cable of an emulated device is pulled from a running daemon, and plugged in again."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.config.states import State
from piezod.daemon.stage.status import STATES
from piezod.telemetry.arrays import RingReader
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import EXAMPLE, Daemon, device_configuration
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated, emulated

AWAY_S = 2.0
RAMP_V_PER_S = 50.0
RATE_HZ = 20.0
LASER = """\
  laser: {driver: micro_epsilon, options: {port: %s, model: ILD1420, timeout_ms: 200}}
"""
AT_LASER = """\
sensor:
      device: laser
      channel: distance
      calibration: {kind: line, gain: 1, offset: -5000}"""


def configured(folder: Path, port: str, laser: str = "") -> Path:
    """Write the configuration of a stage at an E-816, measured by the E-816 or by a laser."""
    changes = {EXAMPLE: port, "timeout_ms: 50": "timeout_ms: 200"}
    changes["rate_hz: 50"] = f"rate_hz: {RATE_HZ:g}"
    if laser:
        changes["\naxes:\n"] = LASER % laser + "\naxes:\n"
        changes["sensor: {device: controller, channel: A}"] = AT_LASER
    return device_configuration(folder, "pi-e816", changes)


def cycles_until_blind(daemon: Daemon) -> int:
    """Return how many cycles without a read-back passed before the stage was BLIND."""
    records = RingReader(attach(daemon.paths.loop_map)).last(200)
    silent = np.isnan(records["axes"]["read_back_v"][:, 0])
    blind = records["state"] == STATES.index(State.BLIND)
    before = silent[: np.argmax(blind)]  # count backwards: a late reply may have come long before
    return int(np.argmin([*before[::-1], False]))


def high_and_there(status: dict[str, Any]) -> bool:
    """Return whether a stage that goes high up is on target."""
    axis = status["axes"]["x"]
    return bool(axis["drive_v"] > 30.0 and axis["on_target"])


@contextmanager
def high_up(start: StartDaemon, folder: Path) -> Iterator[tuple[Daemon, Emulated]]:
    """Yield a daemon whose stage is armed and driven to some 40 V, and its device."""
    arguments = ("--trace", str(folder / "trace.csv"))
    with emulated("pi-e816", arguments=arguments) as far:
        daemon = start(configured(folder, far.where[0])).up()
        daemon.moving("goto", {"position_um": 8.0}, high_and_there)
        yield daemon, far


@pytest.mark.fault("B1")
def test_a_cable_that_is_pulled_and_plugged_in_again(start: StartDaemon, tmp_path: Path) -> None:
    """The stage is BLIND, then ramps down from the read-back voltage, and stays until a reset.

    After the reset it can be armed and moved again.
    """
    with high_up(start, tmp_path) as (daemon, far):
        far.faults(f"disconnect:now:{AWAY_S:g}")
        daemon.until("BLIND")
        blind, cycles = daemon.faults(), cycles_until_blind(daemon)
        before_skipped = daemon.status()["skipped_cycles"]
        refused = daemon.ask("POST", "goto", {"position_um": 1.0}).status_code
        daemon.until("FAULT")
        status = daemon.status()
        latched = daemon.faults()
        with (tmp_path / "trace.csv").open(encoding="ascii") as file:
            rows = [(int(row["t_ns"]), float(row["x_v"])) for row in csv.DictReader(file)]
        eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
        daemon.until("SAFE")
        daemon.driven(5.0, above_v=15.0)
        after_reset = daemon.faults()
        daemon.process.terminate()
        assert daemon.exit_code() == 0

    away = max(pairwise(rows), key=lambda pair: pair[1][0] - pair[0][0])
    after_v = [volts for t_ns, volts in rows if t_ns >= away[1][0]]
    assert "B1" in blind
    assert cycles <= 2
    assert refused == 409
    assert "B1" in latched
    assert status["skipped_cycles"] - before_skipped < AWAY_S * RATE_HZ / 2  # the loop went on
    assert away[1][0] - away[0][0] >= AWAY_S * 1e9
    assert abs(after_v[0] - away[0][1]) <= 2.0 * RAMP_V_PER_S / RATE_HZ
    assert all(b <= a for a, b in pairwise(after_v))
    assert after_v[-1] == pytest.approx(0.0, abs=0.5)
    assert "B1" not in after_reset


@pytest.mark.fault("S10")
def test_another_device_at_the_cable_is_not_driven(start: StartDaemon, tmp_path: Path) -> None:
    """The stage stays BLIND while another device is connected, and nothing is sent to it."""
    with high_up(start, tmp_path) as (daemon, far):
        far.faults("wrong-identity:now:0.5")
        daemon.until("BLIND")
        eventually(lambda: "S10" in daemon.faults())
        written = (tmp_path / "trace.csv").read_text(encoding="ascii").count("\n")
        words = attach(daemon.paths.loop_map).words
        first = words[Word.NEWEST_RECORD]
        eventually(lambda: words[Word.NEWEST_RECORD] > first + 20)
        state = daemon.status()["state"]
        again = (tmp_path / "trace.csv").read_text(encoding="ascii").count("\n")

    assert state == "BLIND"
    assert written == again


@pytest.mark.fault("B1")
def test_a_laser_whose_cable_is_pulled_makes_no_stage_blind(
    start: StartDaemon, tmp_path: Path
) -> None:
    """The amplifier still answers: the stage is held, then ramped down."""
    with emulated("pi-e816") as amplifier, emulated("ild1420") as laser:
        daemon = start(configured(tmp_path, amplifier.where[0], laser.where[0])).up()
        daemon.do("mode", mode="feedforward")
        daemon.do("arm")
        laser.faults("disconnect:now:3")
        daemon.until("FAULT")

        eventually(lambda: "to FAULT" in daemon.text)
        log = daemon.text

    assert "B1" in log
    assert "READY to HOLD" in log
    assert "HOLD to RAMP" in log
    assert "BLIND" not in log


@pytest.mark.fault("A1")
def test_a_device_that_falls_silent_does_not_end_the_loop(
    start: StartDaemon, tmp_path: Path
) -> None:
    """The loop runs on without the device, and ramps it down when it answers again."""
    slow = {"timeout_ms: 30": "timeout_ms: 150", "rate_hz: 200": "rate_hz: 20"}
    with emulated("lc400") as far:
        path = device_configuration(tmp_path, "lc400", {EXAMPLE: far.where[0], **slow})
        daemon = start(path).up()
        daemon.driven(8.0, above_v=30.0)
        words = attach(daemon.paths.loop_map).words
        far.faults("lost")
        daemon.until("BLIND")
        eventually(lambda: "B1" in daemon.faults())
        first, skipped = words[Word.HEALTHY_CYCLES], words[Word.SKIPPED_CYCLES]
        eventually(lambda: words[Word.HEALTHY_CYCLES] > first + RATE_HZ)
        delayed = words[Word.SKIPPED_CYCLES] - skipped
        far.faults()
        daemon.until("FAULT")
        eventually(lambda: abs(daemon.status()["axes"]["x"]["read_back_v"]) < 0.5)

        assert daemon.process.poll() is None
        assert delayed < RATE_HZ / 2
