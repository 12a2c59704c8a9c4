"""The edge between the cycle and the devices: what a driver raises becomes a value here.

The same edge decides whether anything is written at all. Where nothing is, a write is refused; in
shadow it is taken and goes nowhere.

It also keeps what is known of the voltages in force, and when a lost amplifier is tried again.
"""

from collections.abc import Callable, Sequence
from math import isfinite, nan
from typing import Final, Protocol

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.devices.interface import Amplifier, Sample, Sensor
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus
from piezod.units import s_to_ns


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
        if not self.reads_back or self.shadow:  # in shadow it answers to nothing that was asked for
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


SILENT_CYCLES: Final = 5
"""An amplifier with read-back counts as lost after this many cycles without one."""
FIRST_TRY_NS, LAST_TRY_NS = s_to_ns(0.1), s_to_ns(2.0)
"""Pause before a lost amplifier is tried again: after the first loss, and at most."""


class OutputKnowledge:
    """Whether the voltages in force are known.

    Args:
        on_lost: Called when the last written voltage says nothing any more about the one in force.
    """

    def __init__(self, on_lost: Callable[[], None] | None) -> None:
        self.known = False
        """Whether the voltage in force is known on every axis."""
        self.known_when_lost = False
        """Whether it was known when the amplifier was lost."""
        self._on_lost = on_lost
        self._silent_cycles = self._losses = 0

    def take_read_back(self, read_back_v: Sequence[float], *, driven: bool) -> Detection | None:
        """Take the read-back of this cycle; return A1 if the amplifier has fallen silent.

        Call once per cycle, only if the amplifiers have a read-back. Real-time safe.

        Args:
            read_back_v: Voltage of each axis, in V; NaN if the amplifier does not report it.
            driven: Whether voltages are written in this state.
        """
        complete = all(map(isfinite, read_back_v))
        if not driven:
            self.known, self._silent_cycles = complete, 0
            return None
        self._silent_cycles = 0 if complete else self._silent_cycles + 1
        if self._silent_cycles < SILENT_CYCLES:
            return None
        return Detection(Fault.A1, -1, self._silent_cycles, SILENT_CYCLES)

    def lose(self, *, traceable: bool) -> None:
        """Note that the amplifier was lost. Real-time safe.

        Args:
            traceable: Whether the voltage in force can be found out later, from a read-back or
                because the amplifier reports a restart.
        """
        self.known_when_lost, self.known = self.known, False
        self._losses += 1
        if not traceable and self._on_lost is not None:
            self._on_lost()

    def settle(self) -> None:
        """Note that the amplifier works again: the next loss counts as the first."""
        self._losses = 0

    def try_due(self, lost_for_ns: int) -> bool:
        """Return whether a lost amplifier may be tried again; the pause doubles with each loss."""
        pause_ns = FIRST_TRY_NS << min(self._losses - 1, 10)
        return lost_for_ns >= min(pause_ns, LAST_TRY_NS)
