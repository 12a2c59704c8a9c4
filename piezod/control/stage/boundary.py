"""The edge between the cycle and the devices: what a driver raises becomes a value here.

The same edge decides whether anything is written at all. Where nothing is, a write is refused; in
shadow it is taken and goes nowhere.
"""

from collections.abc import Sequence
from math import nan
from typing import Protocol

from piezod.devices.interface import Amplifier, Sample, Sensor
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus


class StageDevices(Sensor, Amplifier, TellsStatus, Protocol):
    """All devices of a stage as one; `devices.channels.Channels` is it."""

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Call these displacements zero from now on."""
        ...

    def commands(self) -> Sequence[Sample]:
        """Tell what commanded each axis when it was read last, in µm; call it in the loop."""
        ...


class DeviceBoundary:
    """The sensor and the amplifier that the cycle sees.

    Args:
        devices: The devices.
        n_axes: Number of their axes.
        reads_back: Whether the amplifiers tell what is in force.
        holds: Whether their outputs stay as they are when they are deactivated.
        tells_restart: Whether they tell, before they take a write, that they were restarted.
    """

    def __init__(
        self,
        devices: StageDevices,
        n_axes: int,
        *,
        reads_back: bool,
        holds: bool,
        tells_restart: bool = False,
    ) -> None:
        self.devices, self.reads_back, self.holds = devices, reads_back, holds
        self.tells_restart = tells_restart
        self._nothing, self._no_flags = [nan] * n_axes, [NO_FLAGS] * (2 * n_axes)
        self._true_zero_um = [0.0] * n_axes
        self.open = False
        """Whether writes go through to the amplifier."""
        self.sent_v: Sequence[float] | None = None
        """What was sent last and not acknowledged: in force or not; None where nothing was."""
        self.shadow = False
        """Whether writes are taken and go nowhere."""
        self.withheld = False
        """Whether writes are refused for now, as somebody else drives the amplifier."""
        self.active = True
        """Whether the devices are active; after a cut they are not, until they are reset."""
        self.crash: Exception | None = None
        """What a driver raised last in this cycle, if it did; whoever looks at it clears it."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take one sample of each axis; invalid ones where the driver fails."""
        if not self.active:
            return [Sample(now_ns, nan, False)] * len(self._nothing)
        try:
            return self.devices.read(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return [Sample(now_ns, nan, False)] * len(self._nothing)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis where that is allowed; may be called in the loop."""
        if self.shadow:
            return True
        if not (self.open and self.active) or self.withheld:
            self.sent_v = None
            return False
        try:
            taken = self.devices.write(drive_v, now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            taken = False
        self.sent_v = None if taken else drive_v
        return taken

    def forget_sent(self, axis: int) -> None:
        """Forget what was sent last to an axis: it is known not to be in force."""
        if self.sent_v is not None:
            self.sent_v = [nan if i == axis else sent for i, sent in enumerate(self.sent_v)]

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what is in force on each axis, in V, NaN where nobody can; call it in the loop."""
        if not self.reads_back:
            return self._nothing
        try:
            return [float(drive_v) for drive_v in self.devices.read_back(now_ns)]
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return self._nothing

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what the sensor of each axis says is the matter, then the amplifier of each.

        May be called in the loop.
        """
        try:
            return self.devices.status(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return self._no_flags

    def activate(self, now_ns: int) -> bool:
        """Make the devices ready for writes; return whether they are; may be called in the loop."""
        try:
            self.devices.activate(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return False
        self.active = True
        return True

    def cut(self, now_ns: int) -> bool:
        """Have the amplifiers switch their outputs off; return whether they did.

        May be called in the loop. One that holds its output when it is deactivated cannot.
        """
        if self.holds:
            return False
        try:
            self.devices.deactivate(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return False
        self.active = False
        return True

    def zero(self, zero_um: Sequence[float]) -> None:
        """Call these displacements, in µm as the devices give them, zero from now on."""
        self.devices.zero(zero_um, self._true_zero_um)
