"""What the dialogues of most devices do in the same way, so that a driver holds only its protocol.

A plug-in may use it too; it need not: a `BusDevice` takes every `Dialogue`.
"""

from collections.abc import Sequence
from math import isnan
from typing import Protocol

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import NO_FLAGS, SATURATED, DeviceFlag, Flags


class Closable(Protocol):
    """What connects a dialogue with its device: a line, a bus, or what is built on them."""

    def close(self) -> None:
        """Disconnect. Never raises."""
        ...


class Noticing(Protocol):
    """What exchanges requests and replies, and notices faults that did not make one fail."""

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear these faults. Real-time safe."""
        ...


class StatusTurns:
    """Tells when which part of a status is asked: one part at a time, each once per period.

    A status may need several exchanges, for example one for each channel. A cycle has time for one
    of them, which then follows the setpoint or the sample.

    Args:
        period_ns: Time in which every part is asked once, in ns.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._asked_ns: int | None = None
        self._next = 0

    def restart(self) -> None:
        """Let the next part be due at once."""
        self._asked_ns = None

    def due(self, now_ns: int, n_turns: int = 1) -> int | None:
        """Return the index of the part that is due, None if none is. Real-time safe.

        Args:
            now_ns: The instant, in ns, of the same clock in every call.
            n_turns: Number of parts; 0 for no status.
        """
        asked_ns = self._asked_ns
        if not n_turns or (asked_ns is not None and now_ns - asked_ns < self._period_ns // n_turns):
            return None
        self._asked_ns = now_ns
        turn = self._next % n_turns
        self._next = (turn + 1) % n_turns
        return turn


class BaseDialogue:
    """Implements of `Dialogue` what does not depend on the protocol.

    A subclass adds `open` and `capabilities`, with inputs `sample`, with outputs `put`, and with a
    read-back `_ask_in_force`. It overrides what its device does otherwise. As it is, outputs hold,
    the device needs no command before or after control, and it reports no status.

    The value in force is asked at most once per instant. A driver whose exchanges report it tells
    that by `_keep_in_force`, and says by `_forget_in_force` that a request may have changed it.

    Args:
        wiring: The channels in use.
        link: The connection, which `close` closes.
        notices: The exchanges, whose noticed faults `take_noticed` reports; None if they have none.
    """

    def __init__(self, wiring: Wiring, link: Closable, notices: Noticing | None) -> None:
        self._wiring, self._link, self._notices = wiring, link, notices
        self._no_flags: Sequence[Flags] = [NO_FLAGS] * (len(wiring.inputs) + len(wiring.outputs))
        self._flags: Sequence[Flags] = (
            self._no_flags
        )  # of each channel, inputs first, as the device reported last
        self._ranges: Sequence[tuple[float, float]] = ()  # of each output, in its unit
        self._noticed: set[DeviceFlag] = set()
        self._in_force: Sequence[float] = ()
        self._in_force_ns: int | None = None

    def close(self) -> None:
        """Disconnect; the outputs keep their values. Never raises."""
        self._link.close()

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the lowest and the highest value of each output, in its unit."""
        return self._ranges

    def activate(self) -> None:
        """Take control; no command is needed."""

    def deactivate(self) -> None:
        """Release control; the outputs hold."""

    def sample(self, now_ns: int) -> Reading:
        """Return no values: there are no inputs. Real-time safe."""
        return now_ns, ()

    def put(self, values: Sequence[float]) -> None:
        """Do nothing: there are no outputs. Real-time safe."""

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the value in force of each output; it is asked once per instant. Real-time safe.

        Raises:
            LineFault: If the exchange fails.
        """
        if self._in_force_ns != now_ns:
            self._keep_in_force(self._ask_in_force(), now_ns)
        return self._in_force

    def flags(self) -> Sequence[Flags]:
        """Return the flags that the device reported last. Real-time safe."""
        return self._flags

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the faults that did not make an exchange fail. Real-time safe."""
        noticed = set() if self._notices is None else self._notices.take_noticed()
        if self._noticed:
            noticed, self._noticed = noticed | self._noticed, set()
        return noticed

    def _flag_saturated(self, values: Sequence[float]) -> None:
        """Report each input whose value is NaN as saturated, and nothing else."""
        self._flags = self._no_flags
        if any(isnan(value) for value in values):
            inputs = [SATURATED if isnan(value) else NO_FLAGS for value in values]
            self._flags = [*inputs, *self._no_flags[len(values) :]]

    def _ask_in_force(self) -> Sequence[float]:
        """Ask for the value in force of each output. Real-time safe."""
        return ()

    def _keep_in_force(self, values: Sequence[float], now_ns: int | None) -> None:
        """Keep what an exchange reported, until another instant than this."""
        self._in_force, self._in_force_ns = values, now_ns

    def _forget_in_force(self) -> None:
        """Let `in_force` ask, also at this instant."""
        self._in_force_ns = None

    def _note_unless_lost(self, fault: LineFault) -> None:
        """Note the fault of an exchange that was made beside a setpoint or a sample.

        Raises:
            LineFault: If the device is lost by it.
        """
        if fault.flag in LOSING:
            raise fault
        self._noticed.add(fault.flag)
