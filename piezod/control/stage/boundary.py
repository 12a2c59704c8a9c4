"""The boundary between the cycle and the devices: exceptions of drivers become values here.

The boundary also decides whether a write reaches the amplifier. While it is closed, writes are
refused; in shadow they are accepted and go nowhere. `OutputKnowledge` keeps whether the voltages in
force are known, and when a lost amplifier is tried again.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from math import isfinite, nan
from typing import Final, Protocol

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.devices.interface import Sample
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus
from piezod.units import s_to_ns


class StageDevices(TellsStatus, Protocol):
    """The open devices of a stage as one; implemented by `devices.channels.Channels`.

    The methods are those of `Sensor` and `Amplifier`, with one value per axis.
    """

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return one sample of each axis. Real-time safe."""
        ...

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back voltage of each axis, in V. Real-time safe."""
        ...

    def watchdogs(self) -> Sequence[bool]:
        """Return of each axis whether its amplifier has a watchdog of its own."""
        ...

    def reads_back(self) -> Sequence[bool]:
        """Return of each axis whether its amplifier reports the voltage in force."""
        ...

    def read_back_age_ns(self, now_ns: int) -> Sequence[int]:
        """Return the age of the last read-back of each axis, in ns. Real-time safe.

        It counts from the cycle that made the first voltage which the read-back cannot show.
        """
        ...

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis, in V; return whether that succeeded. Real-time safe.

        A device that drives an axis with NaN is left alone.
        """
        ...

    def set_lines(self, now_ns: int, *, at_rest: bool) -> None:
        """Set the lines of devices that drive no axis. Real-time safe.

        Those that are low already are left alone at rest.
        """
        ...

    def activate(self, now_ns: int) -> None:
        """Make every device ready for cyclic calls."""
        ...

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest."""
        ...

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Count displacements from these zeros from now on, in µm."""
        ...

    def forget(self) -> None:
        """Drop what was read before: only what is read from now on counts. Real-time safe."""
        ...

    def commands(self) -> Sequence[Sample]:
        """Return the command of each axis from its command input, in µm. Real-time safe."""
        ...


class DeviceBoundary:
    """The sensors and amplifiers that the cycle sees. All methods are real-time safe.

    Args:
        devices: The devices.
        n_axes: Number of their axes.
        reads_back: Whether the amplifier of each axis reports the voltage in force.
        holds: Whether their outputs stay as they are when they are deactivated.
        reports_restart: Whether they report a restart before they take a write.
        watchdog: Whether the amplifier of each axis makes its outputs safe by itself if its host
            falls silent; none does if it is empty.
        lag_cycles: Cycles by which their read-back may be late.
        amplifiers: Name of the amplifier of each axis; one drives all axes if it is empty.
    """

    def __init__(
        self,
        devices: StageDevices,
        n_axes: int,
        *,
        reads_back: Sequence[bool],
        holds: bool,
        reports_restart: bool = False,
        watchdog: Sequence[bool] = (),
        lag_cycles: int = 0,
        amplifiers: Sequence[str] = (),
    ) -> None:
        self.devices, self.reads_back, self.holds = devices, reads_back, holds
        self.any_reads_back = any(reads_back)
        """Whether an amplifier reports its voltage in force."""
        self._all_read_back = all(reads_back)
        self.reports_restart, self.watchdog = reports_restart, watchdog or [False] * n_axes
        self.lag_cycles, self.amplifiers = lag_cycles, amplifiers or [""] * n_axes
        self._unknown_v, self._no_flags = [nan] * n_axes, [NO_FLAGS] * (2 * n_axes)
        self._true_zero_um, self._no_age_ns = [0.0] * n_axes, [0] * n_axes
        self.open = False
        """Whether writes reach the amplifier."""
        self.written_v: Sequence[float] = self._unknown_v
        """Voltages that the amplifiers acknowledged last; NaN if there are none, or if something
        else may have changed the output since."""
        self.sent_v: Sequence[float] | None = None
        """Voltages that were sent last and not acknowledged, which may be in force or not, also
        after a loss; None if the last write was acknowledged, or if something else may have
        changed the output since."""
        self.shadow = False
        """Whether writes are accepted and go nowhere."""
        self.withheld = False
        """Whether writes are refused for now because another program drives the amplifier."""
        self.active = True
        """Whether the devices are active. After a cut they are not, until a reset."""
        self.lent = False
        """Whether a thread outside of the cycle has the devices: the cycle does not call them."""
        self.returned = False
        """Whether the devices came back at a voltage that is not yet known: nothing is written."""
        self.crash: Exception | None = None
        """Last exception of a driver in this cycle; the reader clears it."""

    @property
    def played(self) -> bool:
        """Whether a play has the devices, or has left a voltage that is not yet known."""
        return self.lent or self.returned

    @property
    def writes(self) -> bool:
        """Whether it may write: no other program, thread or doubt has the outputs."""
        return not (self.withheld or self.lent or self.returned)

    def take_back(self) -> None:
        """Take lent devices back. What was read before the end of the loan counts no more."""
        self.lent, self.returned = False, True
        self.devices.forget()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return one sample of each axis; invalid samples if the driver fails."""
        if not self.active or self.lent:
            return [Sample(now_ns, nan, False)] * len(self._unknown_v)
        try:
            return self.devices.read(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return [Sample(now_ns, nan, False)] * len(self._unknown_v)

    def write(self, drive_v: Sequence[float], now_ns: int, held: Collection[int] = ()) -> bool:
        """Write the voltages if that is allowed; return whether they were taken.

        Args:
            drive_v: Voltage of each axis, in V.
            now_ns: Instant of the cycle, in ns.
            held: Axes that are not written: all axes of some of the amplifiers.
        """
        if self.shadow:
            return True
        if not self.writes:
            self.sent_v = None
        if not (self.open and self.active and self.writes):
            return False
        before_v = self.sent_v or self._unknown_v
        sent_v = _with_held(drive_v, self._unknown_v, held) if held else drive_v
        try:
            taken = self.devices.write(sent_v, now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            taken = False
        if taken:
            self.written_v = _with_held(drive_v, self.written_v, held) if held else drive_v
            self.sent_v = _with_held(self._unknown_v, before_v, held) if held else None
        else:
            self.sent_v = _with_held(drive_v, before_v, held)
        return taken

    def set_lines(self, now_ns: int) -> None:
        """Set the lines of devices that drive no axis; only to low where no voltage is written."""
        if self.shadow or self.lent or not self.active:
            return
        try:
            self.devices.set_lines(now_ns, at_rest=not self.open)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error

    def forget_written(self) -> None:
        """Forget the last writes: something else may have changed the outputs since."""
        self.written_v, self.sent_v = self._unknown_v, None

    def took_over(self, axis: int, drive_v: float) -> None:
        """Note that an output was taken over at a voltage, in V; NaN if it is unknown."""
        written_v = list(self.written_v)
        written_v[axis] = drive_v
        self.written_v = written_v

    def forget_sent(self, axis: int) -> None:
        """Forget the last voltage sent to an axis: it is known not to be in force."""
        if self.sent_v is not None:
            self.sent_v = [nan if i == axis else sent for i, sent in enumerate(self.sent_v)]

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back voltage of each axis, in V; NaN if it is unknown.

        It is also NaN for an amplifier without read-back, which only repeats the last write.
        """
        if self.shadow or self.lent or not self.any_reads_back:
            return self._unknown_v
        try:
            read_back_v = self.devices.read_back(now_ns)
            if self._all_read_back and len(read_back_v) == len(self._unknown_v):
                return [float(drive_v) for drive_v in read_back_v]
            return [
                float(drive_v) if reads_back else nan
                for drive_v, reads_back in zip(read_back_v, self.reads_back, strict=True)
            ]
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return self._unknown_v

    def misses(self, axis: int, read_back_v: float) -> bool:
        """Return whether the read-back of an axis, in V, is missing in this cycle: a fault.

        It is not missed in shadow, while the devices are lent, or from an amplifier that reports
        no voltage.
        """
        # In shadow the read-back answers no write of ours.
        unheard = self.shadow or self.lent or not self.reads_back[axis]
        return not (unheard or isfinite(read_back_v))

    def read_back_age_ns(self, now_ns: int) -> Sequence[int]:
        """Return the age of the last read-back of each axis, in ns; 0 while devices are lent."""
        return self._no_age_ns if self.lent else self.devices.read_back_age_ns(now_ns)

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of the sensor of each axis, then those of the amplifier of each axis."""
        try:
            return self.devices.status(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return self._no_flags

    def activate(self, now_ns: int) -> bool:
        """Activate the devices; return whether they are ready for writes."""
        try:
            self.devices.activate(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return False
        self.active = True
        return True

    def cut(self, now_ns: int) -> bool:
        """Switch the outputs of the amplifiers off; return whether they did.

        Amplifiers that hold their output when they are deactivated cannot. A lent one is aborted
        first, and ramps then.
        """
        if self.holds or self.lent:
            return False
        try:
            self.devices.deactivate(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            self.crash = error
            return False
        self.active = False
        self.forget_written()
        return True

    def zero(self, zero_um: Sequence[float]) -> None:
        """Count displacements from these zeros from now on, in µm as the sensors show them."""
        self.devices.zero(zero_um, self._true_zero_um)


def _with_held(
    values_v: Sequence[float], held_v: Sequence[float], held: Collection[int]
) -> Sequence[float]:
    """Return the first voltages, with the second ones for the axes that are held."""
    if not held:
        return values_v
    both = enumerate(zip(values_v, held_v, strict=True))
    return [kept_v if i in held else value_v for i, (value_v, kept_v) in both]


SILENT_CYCLES: Final = 5
"""An amplifier with read-back is lost after this many cycles in a row without one."""
FIRST_TRY_NS, LAST_TRY_NS = s_to_ns(0.1), s_to_ns(2.0)
"""Pause before a lost amplifier is tried again, after the first loss and at most, in ns."""


class OutputKnowledge:
    """Whether the voltages in force are known.

    Args:
        reads_back: Whether the amplifier of each axis reports it.
        on_lost: Called when the voltage in force can no longer be derived from the last write.
    """

    def __init__(self, reads_back: Sequence[bool], on_lost: Callable[[], None] | None) -> None:
        self._reads_back, self._on_lost = reads_back, on_lost
        self._known = self._known_when_lost = [False] * len(reads_back)
        self._silent_cycles = self._losses = 0
        self.unverified = [Detection(Fault.A10, i) for i, each in enumerate(reads_back) if not each]
        """A10 of each axis whose amplifier does not read back."""
        self.left: Mapping[int, str] = {}
        """Axes that a ramp leaves as they are, and why: nothing tells their voltage."""

    @property
    def known(self) -> bool:
        """Whether the voltage in force is known on every axis."""
        return all(self._known)

    def was_known(self, axis: int) -> bool:
        """Return whether the voltage of an axis was known when the amplifier was lost."""
        return self._known_when_lost[axis]

    def know(self, *, known: bool) -> None:
        """Note whether the voltages of all axes are known now. Real-time safe."""
        self._known = [known] * len(self._known)

    def know_unread(self, *, known: bool, axes: int = -1) -> None:
        """Note whether voltages are known that no amplifier reports. Real-time safe.

        Args:
            known: Whether they are.
            axes: The axes, as a bit mask; those with a read-back are left out.
        """
        self._known = [
            known if axes >> i & 1 and not reads_back else before
            for i, (before, reads_back) in enumerate(
                zip(self._known, self._reads_back, strict=True)
            )
        ]

    def missing(self, read_back_v: Sequence[float]) -> bool:
        """Return whether an amplifier with a read-back does not report it. Real-time safe.

        One that is left as it is does not count.

        Args:
            read_back_v: Voltage of each axis, in V; NaN if its amplifier does not report it.
        """
        for i, drive_v in enumerate(read_back_v):
            if not isfinite(drive_v) and self._reads_back[i] and i not in self.left:
                return True
        return False

    def take_read_back(self, read_back_v: Sequence[float], *, driven: bool) -> Detection | None:
        """Take the read-back of this cycle; return A1 if it has been missing for too long.

        Call once per cycle. Real-time safe.

        Args:
            read_back_v: Voltage of each axis, in V; NaN if the amplifier does not report it.
            driven: Whether voltages are written in this state.
        """
        missing = self.missing(read_back_v)
        if not driven:
            if missing or self.left or not self.known:
                self._find_known(read_back_v)
            self._silent_cycles = 0
            return None
        self._silent_cycles = self._silent_cycles + 1 if missing else 0
        if self._silent_cycles < SILENT_CYCLES:
            return None
        return Detection(Fault.A1, -1, self._silent_cycles, SILENT_CYCLES)

    def _find_known(self, read_back_v: Sequence[float]) -> None:
        """Note which voltages are known of a stage that is not driven."""
        self._known = [
            isfinite(drive_v) if reads_back else before
            for drive_v, reads_back, before in zip(
                read_back_v, self._reads_back, self._known, strict=True
            )
        ]

    def lose(self, *, traceable: bool) -> None:
        """Note that the amplifier was lost. Real-time safe.

        Args:
            traceable: Whether the voltage in force can be found out later, from a read-back or
                because the amplifier reports a restart.
        """
        self._known_when_lost = self._known
        self.know(known=False)
        self.left = {}
        self._losses += 1
        if not traceable and self._on_lost is not None:
            self._on_lost()

    def lend(self) -> None:
        """Note that a play changes the voltages; none is known before its end. Real-time safe."""
        self.know(known=False)
        if self._on_lost is not None:
            self._on_lost()

    def settle(self) -> None:
        """Note that the amplifier works again: the next loss counts as the first."""
        self._losses, self.left = 0, {}

    def try_due(self, lost_for_ns: int) -> bool:
        """Return whether a lost amplifier may be tried again; the pause doubles with each loss."""
        pause_ns = FIRST_TRY_NS << min(self._losses - 1, 10)
        return lost_for_ns >= min(pause_ns, LAST_TRY_NS)
