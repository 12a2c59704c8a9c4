"""A stage on the simulated rig, in virtual time, with everything between client and devices."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import inf
from pathlib import Path
from typing import Any, cast

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.config.requests import Request
from piezod.control.assembly import make_stage
from piezod.control.controller import StageController
from piezod.control.stage.answer import Answer
from piezod.control.watch.loop import CycleTiming
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Device
from piezod.devices.wiring import ChannelPair, construct, pairs_of
from piezod.telemetry.record import AxisRecord, CycleRecord, StageEvent
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import Injection, InjectionKind
from piezod.units import NS_PER_S

CONFIG = Path(__file__).parents[2] / "config" / "simulated.yaml"
ON_TIME = CycleTiming(0, 0, 10_000, 0, 0)

QUICK_RAMP_V_PER_S = 200.0

Wrap = Callable[[Device], Device]


@cache
def shipped() -> DaemonConfig:
    """Return the configuration that ships; it is read once, and nobody can change it."""
    return load_daemon(CONFIG, registry)


@cache
def quick() -> DaemonConfig:
    """Return the same, but that conditioning takes 0.4 s, and a ramp a quarter of its time."""
    axis = shipped().axes["x"]
    brief = axis.conditioning.model_copy(update={"cycles": 2, "frequency_hz": 5.0})
    steep = axis.safety.model_copy(update={"ramp_v_per_s": QUICK_RAMP_V_PER_S})
    hasty = axis.model_copy(update={"conditioning": brief, "safety": steep})
    return shipped().model_copy(update={"axes": {"x": hasty}})


class Watched(Channels):
    """Writes down every write that reaches the devices."""

    def __init__(self, devices: Mapping[str, Device], axes: Mapping[str, ChannelPair]) -> None:
        super().__init__(devices, axes)
        self.writes: list[tuple[int, Sequence[float]]] = []

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Write it down, and set the voltage."""
        self.writes.append((now_ns, tuple(drive_v)))
        return super().write(drive_v, now_ns)


class LiveStage:
    """A controller with a rig, driven by a clock that a test turns.

    Args:
        config: The configuration; the one that ships if not given.
        wrap: What each device is wrapped into, for faults.
        memory_known: Whether the hysteresis' memory is known at the start.
        holds: Whether the amplifier says that it keeps its voltage when it is deactivated.
        reads_back: Whether the amplifier says that it tells its voltage.
        tells_restart: Whether the amplifier says that it tells a restart.
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
    ) -> None:
        self.config = config or shipped()
        axes = pairs_of(self.config.axes)
        made = construct(self.config.devices, axes, self.config.seed)
        devices = {name: wrap(device) for name, device in made.items()}
        self.period_ns = round(NS_PER_S / self.config.rate_hz)
        self.t_ns = 0
        self.channels = Watched(devices, axes)
        self.channels.open()
        self.channels.activate(0)
        able = self.channels.capabilities()._replace(
            opens_relaxed=memory_known,
            holds=holds,
            read_back=reads_back,
            tells_restart=tells_restart,
        )
        self.output_lost_ns: list[int] = []
        """Instants at which the last written voltage came to say nothing any more."""
        self.stage = make_stage(
            self.config, self.channels, able, lambda: self.output_lost_ns.append(self.t_ns)
        )
        self.controller = StageController(self.stage)
        self.events: list[StageEvent] = []
        self.records: list[CycleRecord] = []

    @property
    def x(self) -> AxisRecord:
        """The first axis in the last cycle."""
        return self.records[-1].axes[0]

    @property
    def state(self) -> str:
        """The state now."""
        return self.controller.state.value

    def run(self, duration_s: float, timing: CycleTiming = ON_TIME) -> list[CycleRecord]:
        """Run cycles for a time; return their records."""
        first = len(self.records)
        for _ in range(max(1, round(duration_s * NS_PER_S / self.period_ns))):
            self.cycle(timing)
        return self.records[first:]

    def cycle(self, timing: CycleTiming = ON_TIME) -> CycleRecord:
        """Run one cycle, as late as it is told to be; return its record."""
        self.t_ns += self.period_ns * (1 + timing.skipped)
        record = self.controller.cycle(self.t_ns, timing)
        self.records.append(record)
        self.events += self.controller.take_events()
        return record

    def ask(self, request: Request) -> Answer:
        """Ask for something, and run a cycle."""
        answer = self.controller.execute(request, self.t_ns)
        self.cycle()
        return answer

    def do(self, *requests: Request) -> None:
        """Ask for things that have to be accepted, one after the other."""
        for request in requests:
            answer = self.ask(request)
            assert answer.accepted, f"{request}: {answer.why}"

    def until(self, state: str, within_s: float = 10.0) -> None:
        """Run until a state is reached.

        Raises:
            TimeoutError: If it is not reached in time.
        """
        for _ in range(round(within_s * NS_PER_S / self.period_ns)):
            if self.state == state:
                return
            self.cycle()
        raise TimeoutError(f"{state} was not reached, the stage is in {self.state}")

    def faults(self) -> list[str]:
        """Return the ids of the faults that appeared, in their order."""
        return [event.fault for event in self.events if event.kind == "fault"]


class FaultyStage(LiveStage):
    """A stage whose rig fails when a test says so.

    Args:
        config: The configuration; the one that ships if not given.
        holds: Whether the amplifier says that it keeps its voltage when it is deactivated.
        reads_back: Whether the amplifier says that it tells its voltage.
        tells_restart: Whether the amplifier says that it tells a restart.
    """

    def __init__(
        self,
        config: DaemonConfig | None = None,
        *,
        holds: bool = False,
        reads_back: bool = True,
        tells_restart: bool = False,
    ) -> None:
        made: list[FaultyDevice] = []

        def wrapped(device: Device) -> Device:
            made.append(FaultyDevice(cast("SensorAmplifier", device)))
            return made[0]

        super().__init__(
            config, wrapped, holds=holds, reads_back=reads_back, tells_restart=tells_restart
        )
        (self.device,) = made

    def fail(self, kind: InjectionKind, cycles: int | None = None, **what: Any) -> None:
        """Have the rig fail from the next cycle on, for some cycles or for ever."""
        start_ns = self.t_ns + 1
        end_ns = inf if cycles is None else start_ns + cycles * self.period_ns
        self.device.schedule.append(Injection(kind, start_ns, end_ns, **what))
