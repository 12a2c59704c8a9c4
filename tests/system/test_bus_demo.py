"""The whole demo over each bus, with emulator, daemon and client as processes."""

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from benchmarks.bus.example import Place, at_adapter, at_host, at_multicast, at_port, at_pty, placed
from piezod_drivers.serial_line.piezo_board.emulation.build import missing
from tests.conftest import Figure
from tests.daemon.daemons import REPOSITORY, Daemon
from tests.drivers.bus.bench import emulated

BUS = REPOSITORY / "config" / "experiments" / "bus.yaml"
METRICS = ("tracking_max_pct", "nonlinearity_pct")
PAPER_PCT = {"feedforward": (1.87, 2.17, 2.31), "adaptive": (1.49, 1.86, 2.02)}


class Demo(NamedTuple):
    """A stage over a bus."""

    profiles: tuple[str, ...]  #: Emulators of its devices, in the order of the example.
    example: str  #: Example configuration.
    place: Place  #: Puts the place of an emulator into the options of a device.
    rate_hz: float  #: Rate of the loop.


DEMOS = {
    "serial": Demo(("pi-gcs2",), "pi-gcs2", at_port, 150),
    "Modbus TCP": Demo(("labjack-t7",), "labjack-t7", at_host, 250),
    "Modbus RTU": Demo(("waveshare",), "waveshare", at_pty, 100),
    "slcan": Demo(("canopen-401",), "canopen-401", at_adapter, 100),
    "udp_multicast": Demo(
        ("canopen-401=udp:239.74.163.7:43197",), "canopen-401", at_multicast, 100
    ),
    "DBC": Demo(("can-dbc-demo",), "can-dbc", at_adapter, 100),
    **({} if missing() else {"player board": Demo(("board",), "board", at_port, 50)}),
}


def configured(folder: Path, demo: Demo, where: list[str]) -> Path:
    """Write the configuration of a stage over a bus."""
    document = placed(demo.example, where, demo.place, demo.rate_hz)
    for device in document["devices"].values():
        # An emulator is an ordinary process, which may answer later than a device.
        device["options"]["timeout_ms"] = max(device["options"].get("timeout_ms", 0), 30)
    document["loop"] = {"cpu": min(os.sched_getaffinity(0))}  # other tests use the last one
    path = folder / "bus.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def make_punctual(emulator: int) -> None:
    """Give an emulator real-time priority, if that is allowed, because a device has no delays."""
    for task in Path(f"/proc/{emulator}/task").iterdir():
        with suppress(PermissionError):
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(10))


def moved(daemon: Daemon) -> dict[str, Any]:
    """Arm, go to 12.5 µm, and return the status there."""
    armed = daemon.command("arm", "--confirm-output")
    assert armed.returncode == 0, armed.stderr + daemon.text
    gone = daemon.command("goto", "12.5", "--wait")
    assert gone.returncode == 0, gone.stderr + daemon.text
    return daemon.status()


def condition(daemon: Daemon) -> None:
    """Make the hysteresis memory known, as mode adaptive requires, and disarm."""
    daemon.command("disarm")
    daemon.until("SAFE")
    daemon.command("arm", "--confirm-output")
    daemon.until("READY")
    started = daemon.command("condition")
    assert started.returncode == 0, started.stderr + daemon.text
    daemon.until("READY", 60.0)
    daemon.command("disarm")
    daemon.until("SAFE")


def test_a_stage_over_modbus_reaches_its_target(tmp_path: Path) -> None:
    """A stage at an emulated LabJack in another process moves to 12.5 µm."""
    demo = DEMOS["Modbus TCP"]._replace(rate_hz=20)
    with (
        emulated(*demo.profiles) as devices,
        Daemon(configured(tmp_path, demo, devices.where)) as daemon,
    ):
        daemon.up()
        status = moved(daemon)

    assert status["axes"]["x"]["position_um"] == pytest.approx(12.5, abs=0.5)


@pytest.mark.stress
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("bus", DEMOS)
def test_the_papers_figures_are_reached_over_each_bus(
    tmp_path: Path, figure: Figure, bus: str
) -> None:
    """Feedforward and adaptive reach them, with commands that move at most 0.1 % per cycle."""
    demo = DEMOS[bus]
    with (
        emulated(*demo.profiles) as devices,
        Daemon(configured(tmp_path, demo, devices.where)) as daemon,
    ):
        make_punctual(devices.process.pid)
        daemon.up()
        moved(daemon)
        condition(daemon)
        files = str(BUS), "--out", str(tmp_path / "out"), "--largest-step-pct", "0.1"
        ended = daemon.command("experiment", *files, "--live", "--json")

    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    for warning in document["warnings"][1:]:
        figure(f"{bus}, {demo.rate_hz:g} Hz, {warning}")
    missed = []
    for run in document["cases"]:
        paper_pct = PAPER_PCT[run["mode"]][int(run["case"][-1]) - 1]
        worst = max(run[metric] for metric in METRICS)
        figure(
            f"{bus}, {run['case']}, {run['mode']}: tracking {run['tracking_max_pct']:.2f} %, "
            f"nonlinearity {run['nonlinearity_pct']:.2f} %, paper {paper_pct:.2f} %"
        )
        missed += [run] if worst > paper_pct else []
    assert missed == []
