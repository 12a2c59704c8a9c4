"""A stage on the simulated rig in virtual time, with all parts from requests to devices."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import inf
from pathlib import Path
from typing import Any, Self, cast

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.control.assembly import make_stage
from piezod.control.controller import StageController
from piezod.control.faults.detection import Detection
from piezod.control.stage.answer import Answer
from piezod.control.stage.playing import PlayRunner
from piezod.control.watch.loop import CycleTiming, LoopWatch
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Device
from piezod.devices.wiring import ChannelPair, construct, pairs_of
from piezod.messages import requests as rq
from piezod.messages.requests import Request
from piezod.telemetry.record import AxisRecord, CycleRecord, StageEvent
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import Injection, InjectionKind
from piezod.units import NS_PER_S

CONFIG = Path(__file__).parents[2] / "config" / "simulated.yaml"
ON_TIME = CycleTiming(0, 0, 10_000, 0, 0)

QUICK_RAMP_V_PER_S = 200.0
SLEW_V_PER_S = 2000.0

Wrap = Callable[[Device], Device]


@cache
def shipped_config() -> DaemonConfig:
    """Return the configuration in the repository; it is read once, and immutable."""
    return load_daemon(CONFIG, registry)


@cache
def quick_config() -> DaemonConfig:
    """Return the same with conditioning in 0.4 s, a quicker ramp, and a lower slew rate.

    At the slew rate of the repository one step is most of the range, and no step would be a fault.
    """
    axis = shipped_config().axes["x"]
    brief = axis.conditioning.model_copy(update={"cycles": 2, "frequency_hz": 5.0})
    steep = axis.safety.model_copy(update={"ramp_v_per_s": QUICK_RAMP_V_PER_S})
    slow = axis.limits.model_copy(update={"slew_v_per_s": SLEW_V_PER_S})
    return with_axis(shipped_config(), conditioning=brief, safety=steep, limits=slow)


def with_axis(config: DaemonConfig, **changed: object) -> DaemonConfig:
    """Return a configuration of one stage with changes of its axis."""
    axis = config.axes["x"].model_copy(update=changed)
    return config.model_copy(update={"axes": {"x": axis}})


def cycles_until(records: Sequence[CycleRecord], happens: Callable[[CycleRecord], bool]) -> int:
    """Return the number of the first record in which something happens, from 1 on."""
    return next(number for number, record in enumerate(records, 1) if happens(record))


def has_left_run(record: CycleRecord) -> bool:
    """Return whether the stage is in another state than RUN."""
    return record.state is not State.RUN


class RecordingChannels:
    """Records every write that reaches the devices, which read back if they are allowed to.

    It has no base class: nothing can be derived from a compiled `Channels`.
    """

    def __init__(
        self, devices: Mapping[str, Device], axes: Mapping[str, ChannelPair], *, reads_back: bool
    ) -> None:
        self._channels = Channels(devices, axes)
        self._allowed = reads_back
        self.writes: list[tuple[int, Sequence[float]]] = []

    def reads_back(self) -> list[bool]:
        """Return of each axis whether its amplifier reads back, and may."""
        return [self._allowed and each for each in self._channels.reads_back()]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Record the write, and pass it on."""
        self.writes.append((now_ns, tuple(drive_v)))
        return self._channels.write(drive_v, now_ns)

    def __getattr__(self, name: str) -> Any:
        """Return what the channels have."""
        return getattr(self._channels, name)


class RigStage:
    """A controller with a simulated rig; the test advances the time.

    Its amplifier keeps its voltage when it is deactivated, reads back, and reports a restart as
    `holds`, `reads_back` and `tells_restart` say.
    """

    def __init__(
        self,
        config: DaemonConfig | None = None,
        wrap: Wrap = lambda device: device,
        *,
        memory_known: bool = True,
        holds: bool = False,
        reads_back: bool = True,
        tells_restart: bool = False,
        plays: PlayRunner | None = None,
    ) -> None:
        self.config = config or shipped_config()
        axes = pairs_of(self.config.axes)
        built = construct(self.config.devices, axes, self.config.seed)
        devices = {name: wrap(device) for name, device in built.items()}
        self.wrapped = tuple(devices.values())
        self.period_ns = round(NS_PER_S / self.config.rate_hz)
        self.t_ns = 0
        self.channels = RecordingChannels(devices, axes, reads_back=reads_back)
        self.channels.open()
        self.channels.activate(0)
        self._able, self._plays = (
            self.channels.capabilities()._replace(
                opens_relaxed=memory_known,
                holds=holds,
                tells_restart=tells_restart,
            ),
            plays,
        )
        self.output_lost_ns: list[int] = []
        """Instants at which the voltage in force could no longer be derived from the last write."""
        self.events: list[StageEvent] = []
        self.records: list[CycleRecord] = []
        self._assemble()

    def _assemble(self) -> None:
        """Make stage and controller."""
        self.stage = make_stage(
            self.config,
            self.channels,
            self._able,
            lambda: self.output_lost_ns.append(self.t_ns),
            self._plays,
        )
        self.controller = StageController(
            self.stage, LoopWatch(self.period_ns, strict=self.config.loop.strict_rt)
        )

    def kill_loop(self) -> None:
        """Let a new loop take over from one that was killed, as the loop process does."""
        latched, stopped = self.stage.register.latched, bool(self.stage.register.stopping)
        self._able, noted_v = (
            self._able._replace(opens_relaxed=False),
            self.stage.boundary.written_v,
        )
        self.channels.activate(self.t_ns)
        self._assemble()
        self.controller.restore_faults(latched, stopped=stopped)
        self.controller.report(Detection(Fault.P2))
        self.controller.know_last_writes(noted_v)
        self.controller.ramp_first()

    @property
    def x(self) -> AxisRecord:
        """First axis in the last cycle."""
        return self.records[-1].axes[0]

    @property
    def output_v(self) -> float:
        """Voltage that is read back now, in V."""
        return float(self.channels.read_back(self.t_ns)[0])

    @property
    def state(self) -> str:
        """Present state."""
        return self.controller.state.value

    def run(self, duration_s: float, timing: CycleTiming = ON_TIME) -> list[CycleRecord]:
        """Run cycles for a time; return their records."""
        first = len(self.records)
        for _ in range(max(1, round(duration_s * NS_PER_S / self.period_ns))):
            self.cycle(timing)
        return self.records[first:]

    def cycle(self, timing: CycleTiming = ON_TIME) -> CycleRecord:
        """Run one cycle with this timing; return its record."""
        self.t_ns += self.period_ns * (1 + timing.skipped)
        record = self.controller.cycle(self.t_ns, timing)
        self.records.append(record)
        self.events += self.controller.take_events()
        return record

    def ask(self, request: Request) -> Answer:
        """Send a request, and run a cycle; return the answer."""
        answer = self.controller.execute(request, self.t_ns)
        self.cycle()
        return answer

    def do(self, *requests: Request) -> None:
        """Send requests that must be accepted, one after the other."""
        for request in requests:
            answer = self.ask(request)
            assert answer.accepted, f"{request}: {answer.why}"

    def armed(self, *requests: Request) -> Self:
        """Arm it in SAFE, and send these requests, which must be accepted; return it."""
        self.until("SAFE")
        self.do(rq.Arm(), *requests)
        return self

    def until(self, state: str, within_s: float = 10.0) -> None:
        """Run until a state is reached."""
        for _ in range(round(within_s * NS_PER_S / self.period_ns)):
            if self.state == state:
                return
            self.cycle()
        raise TimeoutError(f"{state} was not reached, the stage is in {self.state}")

    def cycles_to(self, fault: str, since_ns: int) -> int:
        """Return the number of cycles from an instant to the first event of a fault after it."""
        found_ns = next(
            event.t_ns for event in self.events if event.fault == fault and event.t_ns > since_ns
        )
        return (found_ns - since_ns) // self.period_ns

    def faults(self) -> list[str]:
        """Return the ids of the faults that appeared, in order."""
        return [event.fault for event in self.events if event.kind == "fault"]


class FaultyStage(RigStage):
    """A stage whose rig fails on command."""

    def __init__(
        self,
        config: DaemonConfig | None = None,
        *,
        faulty: Callable[[SensorAmplifier], FaultyDevice] = FaultyDevice,
        **options: Any,
    ) -> None:
        super().__init__(config, lambda device: faulty(cast("SensorAmplifier", device)), **options)
        (self.device,) = cast("tuple[FaultyDevice]", self.wrapped)

    def fail(self, kind: InjectionKind, cycles: int | None = None, **what: Any) -> None:
        """Make the rig fail from the next cycle on, for some cycles or for ever."""
        start_ns = self.t_ns + 1
        end_ns = inf if cycles is None else start_ns + cycles * self.period_ns
        self.device.schedule.append(Injection(kind, start_ns, end_ns, **what))
