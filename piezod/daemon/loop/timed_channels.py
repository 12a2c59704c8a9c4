"""The devices of a stage, with a stopwatch: how long reading and writing took in a cycle."""

from collections.abc import Sequence

from piezod.control.stage.boundary import StageDevices
from piezod.daemon.clock import Clock
from piezod.daemon.last_output import LastOutputWriter
from piezod.devices.interface import Capabilities, Identity, Sample
from piezod.devices.status import Flags

NOT_WRITTEN = -1


class TimedChannels:
    """Implements the devices of a stage over them; notes what is written.

    Args:
        devices: The devices.
        clock: The clock of the loop.
        noted: Where the voltages are noted, for `piezod safe`.
    """

    def __init__(self, devices: StageDevices, clock: Clock, noted: LastOutputWriter) -> None:
        self._devices, self._now_ns, self._noted = devices, clock.now_ns, noted
        self.read_ns = 0
        """How long reading took since `start`, reading back included."""
        self.write_ns = 0
        """How long writing took since `start`."""
        self.write_begin_ns = NOT_WRITTEN
        """When writing began, -1 where nothing was written since `start`."""

    def start(self) -> None:
        """Begin a cycle; may be called in the loop."""
        self.read_ns = self.write_ns = 0
        self.write_begin_ns = NOT_WRITTEN

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take one sample of each axis; may be called in the loop."""
        begin_ns = self._now_ns()
        try:
            return self._devices.read(now_ns)
        finally:
            self.read_ns += self._now_ns() - begin_ns

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell the voltage now in force, in V, per axis; may be called in the loop."""
        begin_ns = self._now_ns()
        try:
            return self._devices.read_back(now_ns)
        finally:
            self.read_ns += self._now_ns() - begin_ns

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis, in V; may be called in the loop."""
        self.write_begin_ns = begin_ns = self._now_ns()
        self._noted.note(drive_v, begin_ns)
        try:
            return self._devices.write(drive_v, now_ns)
        finally:
            self.write_ns += self._now_ns() - begin_ns

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what the devices say is the matter with each axis; may be called in the loop."""
        return self._devices.status(now_ns)

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Call these displacements zero from now on."""
        self._devices.zero(zero_um, true_zero_um)

    def commands(self) -> Sequence[Sample]:
        """Tell what commanded each axis when it was read last; may be called in the loop."""
        return self._devices.commands()

    def open(self) -> Identity:
        """Open every device."""
        return self._devices.open()

    def capabilities(self) -> Capabilities:
        """Tell what all devices can do together."""
        return self._devices.capabilities()

    def activate(self, now_ns: int) -> None:
        """Make every device ready for cyclic calls."""
        self._devices.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest."""
        self._devices.deactivate(now_ns)

    def close(self) -> None:
        """Make the outputs of every device safe and let go of it."""
        self._devices.close()
