"""Lines of the loop: digital channels of a Modbus and of a CAN device, and of the simulated rig."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import groupby, pairwise
from math import nan
from pathlib import Path
from typing import Any, Protocol

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.control.assembly import assemble
from piezod.control.cycle import PUNCTUAL
from piezod.control.stage.lines import StageLines
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.loop import accept
from piezod.daemon.loop.devices import make_channels
from piezod.messages import requests as rq
from piezod.messages.requests import Wave
from piezod.telemetry.record import CycleRecord
from piezod.units import NS_PER_S
from tests.daemon.daemons import configuration
from tests.daemon.loop.can_lines import can_lines
from tests.drivers.modbus.digital_server import DigitalServer, digital_server

RATE_HZ = 100
LINES = "{exposed: {device: io, input: exposed}, shutter: {device: io, output: shutter}}"
WAVE = {"x": {"kind": "points", "points": [[0.0, 0.0], [0.5, 5.0], [1.0, 5.0], [1.5, 10.0]]}}
MODBUS = """
    driver: modbus
    options:
      host: 127.0.0.1
      tcp_port: {port}
      timeout_ms: 500
      registers:
        - {{channel: exposed, role: input, table: discrete, address: 5}}
        - {{channel: shutter, role: output, table: coil, address: 3}}
"""


class Node(Protocol):
    """A device with a digital input and a digital output."""

    high: bool  #: Level of its input.
    levels: list[bool]  #: Levels to which its output was set.


@contextmanager
def modbus_lines() -> Iterator[tuple[DigitalServer, str]]:
    """Serve a device; yield it and its part of a configuration."""
    with digital_server() as server:
        yield server, MODBUS.format(port=server.port)


class LineStage:
    """A simulated stage with a device of lines, whose loop runs in the time of the test."""

    def __init__(self, folder: Path, device: str) -> None:
        rig = f"{{driver: simulated, options: {{variant: stack}}}}\n  io: {device}"
        path = configuration(folder, rate_hz=str(RATE_HZ), rig=rig)
        with path.open("a", encoding="utf-8") as file:
            file.write(f"\nlines: {LINES}\n")
        self.config: DaemonConfig = accept.load(path)
        self.channels = make_channels(self.config)
        self.channels.open()
        self.channels.activate(0)
        able, levels = self.channels.capabilities(), self.channels.levels
        self.controller = assemble(self.config, self.channels, able, levels=levels)
        self.t_ns = 0
        self.records: list[CycleRecord] = []
        self.events: list[str] = []

    def run(self, cycles: int) -> list[CycleRecord]:
        """Run cycles; return their records."""
        for _ in range(cycles):
            self.t_ns += NS_PER_S // RATE_HZ
            self.records.append(self.controller.cycle(self.t_ns, PUNCTUAL))
            self.events += [each.text for each in self.controller.take_events()]
        return self.records[-cycles:]

    def ask(self, request: rq.Request) -> str:
        """Send a request; return why it is refused."""
        return self.controller.execute(request, self.t_ns).why

    def armed(self) -> "LineStage":
        """Arm it, and go to the begin of the waveform."""
        self.run(10)
        assert not self.ask(rq.Arm())
        self.run(1)
        assert not self.ask(rq.Goto(position_um=0.0))
        self.run(60)
        return self


@pytest.fixture(params=[modbus_lines, can_lines])
def io(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Any, LineStage]]:
    """Return a device of lines, and a stage that is armed."""
    serve: Callable[[], AbstractContextManager[tuple[Any, str]]] = request.param
    with serve() as (node, device):
        stage = LineStage(tmp_path, device).armed()
        yield node, stage
        stage.channels.close()


def wave(**lines: Any) -> Wave:
    """Return a waveform with lines."""
    return Wave.model_validate({"command_um": WAVE, "duration_s": 1.5, **lines}, strict=False)


def pulses(*begins_s: float, **more: Any) -> dict[str, Any]:
    """Return a train of pulses."""
    return {"line": "shutter", "begins_s": begins_s, "high_s": 0.02, **more}


def test_output_pulses_in_step_with_the_motion(io: tuple[Any, LineStage]) -> None:
    """Each pulse comes in its cycle, is recorded, and the device counts as many."""
    node, stage = io
    trains = (pulses(0.095, 0.495, every_s=0.05, times=3),)
    assert not stage.ask(wave(pulses=trains))
    begin_ns = stage.t_ns
    high = [record.t_ns for record in stage.run(200) if record.lines & 2]
    cycles = [(t_ns - begin_ns) * RATE_HZ // NS_PER_S for t_ns in high]

    assert cycles == [10, 11, 15, 16, 20, 21, 50, 51, 55, 56, 60, 61]
    assert sum(now > before for before, now in pairwise(node.levels)) == 6
    assert not node.levels[-1]


def test_skipped_cycles_delay_a_pulse(io: tuple[Any, LineStage]) -> None:
    """None is lost, and each is an edge of its own."""
    node, stage = io
    assert not stage.ask(wave(pulses=(pulses(0.095, every_s=0.05, times=6, high_s=0.01),)))
    stage.run(8)
    stage.t_ns += 8 * NS_PER_S // RATE_HZ
    begin_ns = stage.t_ns
    high = [record.t_ns for record in stage.run(60) if record.lines & 2]

    assert [(t_ns - begin_ns) * RATE_HZ // NS_PER_S for t_ns in high] == [1, 3, 5, 9, 14, 19]
    assert sum(now > before for before, now in pairwise(node.levels)) == 6


def test_motion_waits_for_an_edge(io: tuple[Any, LineStage]) -> None:
    """It stands still at the wait, goes on with the edge, and an early edge moves nothing."""
    node, stage = io
    edges = {"line": "exposed", "first_s": 0.5, "within_s": 5.0}
    assert not stage.ask(wave(edges=edges))
    stage.run(20)
    node.high = True
    stage.run(10)
    node.high = False
    waited = stage.run(100)[-1].axes[0]
    node.high = True
    went_on = stage.run(110)[-1].axes[0]

    assert waited.command_um == pytest.approx(5.0, abs=0.01)
    assert waited.remaining_s == pytest.approx(1.0)
    assert went_on.command_um == pytest.approx(10.0, abs=0.01)
    assert went_on.remaining_s == 0.0
    assert {record.lines & 1 for record in stage.records} == {0, 1}


def test_motion_ends_without_an_edge(io: tuple[Any, LineStage]) -> None:
    """After the longest wait it stays where it is, and says that it has ended."""
    _, stage = io
    edges = {"line": "exposed", "first_s": 0.5, "within_s": 0.2}
    assert not stage.ask(wave(edges=edges))
    last = stage.run(150)[-1]

    assert last.state is State.RUN
    assert last.axes[0].command_um == pytest.approx(5.0, abs=0.01)
    assert last.axes[0].remaining_s == 0.0


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ({"pulses": ({**pulses(0.0), "line": "laser"},)}, "exposed, shutter"),
        ({"pulses": ({**pulses(0.0), "line": "exposed"},)}, "name an output"),
        ({"pulses": (pulses(0.0), pulses(0.5))}, "begins_s"),
        ({"edges": {"line": "laser", "first_s": 0.5, "within_s": 5.0}}, "exposed, shutter"),
    ],
)
def test_wrong_line_is_refused(
    io: tuple[Any, LineStage], lines: dict[str, Any], words: str
) -> None:
    """An unknown line, and pulses of an input, move nothing."""
    _, stage = io

    assert words in stage.ask(wave(**lines))
    assert stage.run(5)[-1].axes[0].command_um == 0.0


def test_lost_device_ends_the_motion_at_the_safe_voltage(tmp_path: Path) -> None:
    """The voltages stay until HOLD ramps them down; the event names the line."""
    with can_lines() as (node, device):
        stage = LineStage(tmp_path, device).armed()
        assert not stage.ask(wave(edges={"line": "exposed", "first_s": 0.5, "within_s": 99.0}))
        stage.run(80)
        node.gone.set()
        held = stage.run(20)
        stage.run(500)
        stage.channels.close()

    assert held[-1].state is State.HOLD
    assert held[-1].axes[0].drive_v == pytest.approx(stage.records[-500].axes[0].drive_v, abs=0.5)
    assert stage.records[-1].state is State.SAFE
    assert stage.records[-1].axes[0].read_back_v == pytest.approx(0.0, abs=0.1)
    assert any("line exposed of device io" in text for text in stage.events)


def test_refused_coil_ends_the_motion_at_the_safe_voltage(tmp_path: Path) -> None:
    """A Modbus exception concerns the line alone: no write of a voltage is refused."""
    with modbus_lines() as (server, device):
        stage = LineStage(tmp_path, device).armed()
        server.refuses = True
        assert not stage.ask(wave(pulses=(pulses(0.1, every_s=0.05, times=20),)))
        stage.run(500)
        stage.channels.close()

    states = [state for state, _ in groupby(record.state for record in stage.records)]
    assert states[-4:] == [State.RUN, State.HOLD, State.RAMP, State.SAFE]
    assert all(record.written for record in stage.records)
    assert any("line shutter of device io" in text for text in stage.events)


def test_motion_of_another_request_sets_the_lines_low(io: tuple[Any, LineStage]) -> None:
    """The pulses end with their motion, in the middle of a pulse, too."""
    node, stage = io
    assert not stage.ask(wave(pulses=(pulses(0.0, high_s=1.0),)))
    stage.run(50)
    assert node.levels[-1]
    assert not stage.ask(rq.Goto(position_um=3.0))
    last = stage.run(5)[-1]

    assert last.lines & 2 == 0
    assert not node.levels[-1]


def test_lost_amplifier_sets_the_lines_low(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In BLIND no voltage is written, but a shutter must not stay open."""
    with modbus_lines() as (node, device):
        stage = LineStage(tmp_path, device).armed()
        assert not stage.ask(wave(pulses=(pulses(0.0, high_s=5.0),)))
        stage.run(20)
        assert node.levels[-1]
        monkeypatch.setattr(stage.channels.devices["rig"], "read_back", lambda _now_ns: [nan])
        last = stage.run(50)[-1]
        stage.channels.close()

    assert last.state is State.BLIND
    assert not node.levels[-1]


def test_device_that_is_lost_after_the_motion_ends_nothing(tmp_path: Path) -> None:
    """A stage that rests at the end of a motion does not need its lines any more."""
    with can_lines() as (node, device):
        stage = LineStage(tmp_path, device).armed()
        assert not stage.ask(wave(pulses=(pulses(0.1),)))
        stage.run(200)
        node.gone.set()
        last = stage.run(30)[-1]
        stage.channels.close()

    assert last.state is State.RUN


def test_late_cycles_end_a_motion_with_lines(io: tuple[Any, LineStage]) -> None:
    """Its pulses would be lost in the pause, and nobody would know."""
    node, stage = io
    assert not stage.ask(wave(pulses=(pulses(0.0, every_s=0.1, times=14),)))
    stage.run(50)
    for _ in range(60):  # more than a tenth of the cycles of 5 s
        stage.t_ns += 2 * NS_PER_S // RATE_HZ
        late = CycleTiming(0, 1, 10_000, 0, 0)
        stage.records.append(stage.controller.cycle(stage.t_ns, late))
    held_um = stage.records[-1].axes[0].position_um
    last = stage.run(700)[-1]

    assert State.HOLD in {record.state for record in stage.records}
    assert last.state is State.RUN
    assert last.axes[0].command_um == pytest.approx(held_um, abs=0.3)
    assert any("lines are in step" in text for text in stage.events)
    assert not node.levels[-1]


def test_mistake_in_the_lines_holds_the_voltages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is a fault of the stage; the loop goes on, and ramps down."""

    def fails(*_: Any, **__: Any) -> str:
        raise ValueError("a mistake")

    with modbus_lines() as (_, device):
        stage = LineStage(tmp_path, device).armed()
        monkeypatch.setattr(StageLines, "advance", fails)
        last = stage.run(500)[-1]
        stage.channels.close()

    assert last.state in {State.HOLD, State.RAMP, State.SAFE, State.FAULT}
    assert any("a mistake" in text for text in stage.events)
