"""The loop of a stage in virtual time: what the loop process runs, without clock and real time."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from piezod.config.daemon import DaemonConfig
from piezod.control.assembly import assemble
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.loop.loop import Loop
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.devices.channels import Channels
from piezod.devices.interface import Device
from piezod.devices.wiring import construct, pairs_of
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

_START_NS: Final = 1_000_000_000_000
_BEAT: Final = int(Word.SUPERVISOR_BEAT_NS)


class VirtualClock:
    """A clock that jumps to the end of each sleep, and further if the test says so."""

    def __init__(self) -> None:
        self.t_ns = _START_NS
        self.oversleeps_ns = 0
        """By how much the next sleep is too long, in ns."""
        self.woken: Callable[[int], object] = lambda _t_ns: None
        """Called after each sleep with the instant."""

    def now_ns(self) -> int:
        """Return the instant, in ns."""
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep."""
        self.t_ns = t_ns + self.oversleeps_ns
        self.oversleeps_ns = 0
        self.woken(self.t_ns)


class VirtualLoop:
    """A loop in virtual time, whose supervisor is always alive.

    Args:
        config: The configuration.
        folder: Folder of the shared memory.
        wrap: What becomes of the devices.
        replace: What becomes of the channels of all of them.
    """

    def __init__(
        self,
        config: DaemonConfig,
        folder: Path,
        wrap: Callable[[Device], Device] = lambda device: device,
        replace: Callable[[Channels], Any] = lambda channels: channels,
    ) -> None:
        pairs = pairs_of(config.axes)
        built = construct(config.devices, pairs, config.seed)
        self.devices: Mapping[str, Device] = {name: wrap(each) for name, each in built.items()}
        channels, self.clock = Channels(self.devices, pairs), VirtualClock()
        channels.open()
        channels.activate(self.clock.t_ns)
        self.shared = create(folder / "loop.map", Layout.of(config))
        words = self.shared.words
        self.clock.woken = lambda t_ns: words.__setitem__(_BEAT, t_ns)
        last_output = LastOutputWriter(folder / "output.map", len(config.axes))
        timed = TimedChannels(replace(channels), self.clock, last_output)
        self.controller = assemble(config, timed, channels.capabilities())
        self.controller.stay_in_boot(False)
        pacer = Pacer(self.clock, round(NS_PER_S / config.rate_hz), 0)
        loop = Loop(self.controller, timed, self.shared, self.clock, pacer)
        # Page faults of this process are faults of a stage, too, and come when they want.
        loop.counters.publish = tuple  # type: ignore[method-assign]
        self.cycle = loop.cycle

    def run(self, cycles: int) -> None:
        """Run cycles."""
        cycle = self.cycle
        for _ in range(cycles):
            cycle()

    def do(self, request: Any) -> str:
        """Carry out a request; return why it was refused, empty if it was not."""
        return self.controller.execute(request, self.clock.t_ns).why
