"""The devices of a stage, with the time that reading and writing took in a cycle."""

from collections.abc import Sequence
from typing import Final

from piezod.control.stage.boundary import StageDevices
from piezod.daemon.clock import Clock
from piezod.daemon.last_output import LastOutputWriter
from piezod.devices.interface import Sample

NOT_WRITTEN: Final = -1
"""Instead of the instant of a write, if a cycle wrote nothing."""


class TimedChannels:
    """Forwards calls to the devices, measures them, and stores the voltages that are written.

    Args:
        devices: The devices.
        clock: The clock of the loop.
        last_output: Stores the voltages, for `piezod safe`.
    """

    def __init__(self, devices: StageDevices, clock: Clock, last_output: LastOutputWriter) -> None:
        self._devices, self._now_ns, self._last_output = devices, clock.now_ns, last_output
        # What is not measured costs no call more.
        self.status, self.read_back_age_ns = devices.status, devices.read_back_age_ns
        self.read_ns = 0
        """Duration of reading and reading back since `start`, in ns."""
        self.write_ns = 0
        """Duration of writing since `start`, in ns."""
        self.write_begin_ns = NOT_WRITTEN
        """Instant at which writing began; -1 if nothing was written since `start`."""

    def start(self) -> None:
        """Begin a cycle. Real-time safe."""
        self.read_ns = self.write_ns = 0
        self.write_begin_ns = NOT_WRITTEN

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return one sample of each axis. Real-time safe."""
        begin_ns = self._now_ns()
        try:
            return self._devices.read(now_ns)
        finally:  # the time has passed even if the driver raises
            self.read_ns += self._now_ns() - begin_ns

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back voltage of each axis, in V. Real-time safe."""
        begin_ns = self._now_ns()
        try:
            return self._devices.read_back(now_ns)
        finally:
            self.read_ns += self._now_ns() - begin_ns

    def watchdogs(self) -> Sequence[bool]:
        """Return of each axis whether its amplifier has a watchdog of its own."""
        return self._devices.watchdogs()

    def reads_back(self) -> Sequence[bool]:
        """Return of each axis whether its amplifier reports the voltage in force."""
        return self._devices.reads_back()

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis, in V; return whether that succeeded. Real-time safe."""
        self.write_begin_ns = begin_ns = self._now_ns()
        # Before the write: if the process dies in between, the file still has the newest voltage.
        self._last_output.note(drive_v, begin_ns)
        try:
            return self._devices.write(drive_v, now_ns)
        finally:
            self.write_ns += self._now_ns() - begin_ns

    def set_lines(self, now_ns: int, *, at_rest: bool) -> None:
        """Set the lines of devices that drive no axis. Real-time safe."""
        begin_ns = self._now_ns()
        try:
            self._devices.set_lines(now_ns, at_rest=at_rest)
        finally:
            self.write_ns += self._now_ns() - begin_ns

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Use these displacements as zero from now on, in µm."""
        self._devices.zero(zero_um, true_zero_um)

    def commands(self) -> Sequence[Sample]:
        """Return the value that commanded each axis at its last read. Real-time safe."""
        return self._devices.commands()

    def forget(self) -> None:
        """Drop what was read before: only what is read from now on counts. Real-time safe."""
        self._devices.forget()

    def activate(self, now_ns: int) -> None:
        """Make every device ready for cyclic calls."""
        self._devices.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest."""
        self._devices.deactivate(now_ns)
