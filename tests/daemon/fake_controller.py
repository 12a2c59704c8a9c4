"""A controller that records the calls of the loop."""

from math import nan

from piezod.config.drive_limits import DriveLimit
from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.detection import Detection
from piezod.control.stage.answer import Answer
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.messages.requests import Request, Shutdown
from piezod.telemetry.learned import LearnedValues
from piezod.telemetry.record import AxisRecord, CycleRecord, StageEvent
from piezod.testing.fake_clock import FakeClock


class FakeController:
    """Accepts every request; reads and writes in each cycle like the real one."""

    def __init__(self, devices: TimedChannels, clock: FakeClock) -> None:
        self._devices, self.clock = devices, clock
        self.finished = False
        self.state = State.RUN
        self.busy_ns = 0
        self.command_um = nan
        self.requests: list[Request] = []
        self.setpoints: list[tuple[int, float, int]] = []
        self.timings: list[CycleTiming] = []
        self.detections: list[Detection] = []
        self.events: list[StageEvent] = []

    def execute(self, request: Request, t_ns: int) -> Answer:  # noqa: ARG002 - as the real one
        """Record a request; a shutdown finishes."""
        self.requests.append(request)
        self.finished = isinstance(request, Shutdown)
        return Answer(accepted=True, motion=len(self.requests), duration_s=0.5)

    def stream_um(self, axis: int, position_um: float, t_ns: int) -> None:
        """Record a setpoint."""
        self.setpoints.append((axis, position_um, t_ns))

    def report(self, detection: Detection) -> None:
        """Record a detection."""
        self.detections.append(detection)

    def take_events(self) -> list[StageEvent]:
        """Return the events of a test."""
        events, self.events = self.events, []
        return events

    def learned(self, axis: int) -> LearnedValues:
        """Return values that differ between axes."""
        return [axis + 0.5], 1.0, 2.0, 3.0, False, 0.0, 0.0, 26.0

    def cycle(self, t_ns: int, timing: CycleTiming) -> CycleRecord:
        """Read, spend time, write."""
        self.timings.append(timing)
        sample = self._devices.read(t_ns)[0]
        read_back_v = self._devices.read_back(t_ns)[0]
        self.clock.spend_ns(self.busy_ns)
        written = self.state is State.RUN and self._devices.write([7.5, 8.5], t_ns)
        axis = AxisRecord(
            sample.t_ns,
            sample.position_um,
            self.command_um,
            nan,
            nan,
            nan,
            7.5,
            6.5,
            read_back_v,
            0.0,
            Mode.ADAPTIVE,
            GateReason.QUIET,
            True,
            3,
            DriveLimit.NONE,
        )
        faults = 1 << 70 | 1 << 3
        return CycleRecord(t_ns, self.state, False, written, faults, 1 << 64, [axis, axis])
