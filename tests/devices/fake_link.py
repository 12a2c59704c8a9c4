"""A fake sensor and amplifier on a wire that tests can pull."""

from collections.abc import Sequence
from math import nan

from piezod.devices.interface import Capabilities, Identity, Sample
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceUnavailableError, PortHeldError

WHO = Identity("maker", "stage", "1", "1.0")
OTHER = WHO._replace(serial="2")


class FakeLink:
    """Implements all roles and `CanBeLost`; one input, one output.

    Attributes:
        who: Identity of the device that answers.
        pulled: Whether the wire is pulled.
        taken: Whether another program holds the port.
        silent: Whether the device answers nothing, on a wire that is all right.
        done: Calls, without reads.
        drive_v: Voltage in force.
        reads: Number of reads.
    """

    def __init__(self) -> None:
        self.who, self.pulled, self.taken, self.silent = WHO, False, False, False
        self.lost = ""
        self.done: list[str] = []
        self.drive_v: Sequence[float] = [0.0]
        self.reads = 0
        self.is_open = False
        self._events: set[DeviceFlag] = set()

    def open(self) -> Identity:
        self.done.append("open")
        if self.taken:
            raise PortHeldError("held by x")
        if self.pulled or self.silent:
            raise DeviceUnavailableError("nobody there")
        self.is_open, self.lost = True, ""
        return self.who

    def capabilities(self) -> Capabilities:
        return Capabilities(("x",), ("x",), read_back=True, max_rate_hz=1000.0, holds=True)

    def activate(self, now_ns: int) -> None:
        self.done.append(f"activate {now_ns}")

    def deactivate(self, now_ns: int) -> None:
        self.done.append(f"deactivate {now_ns}")

    def close(self) -> None:
        self.is_open = False
        self.done.append("close")

    def read(self, now_ns: int) -> Sequence[Sample]:
        self.reads += 1
        return [Sample(now_ns, nan if self._fails() else 1.0, not (self.pulled or self.silent))]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        if self._fails():
            return False
        self.done.append(f"write {now_ns}")
        self.drive_v = list(drive_v)
        return True

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        return self.write(drive_v, now_ns), self.read(now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - protocol
        return [nan] if self._fails() else self.drive_v

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - protocol
        events = frozenset(self._events)
        self._events.clear()
        return [events, events] if events else [NO_FLAGS, NO_FLAGS]

    def noticed(self, flag: DeviceFlag) -> None:
        """Report this flag once."""
        self._events.add(flag)

    def _fails(self) -> bool:
        if self.pulled and not self.lost:
            self.lost = "the wire is pulled"
            self._events.add(DeviceFlag.HALF_OPEN)
        if self.silent:
            self._events.add(DeviceFlag.LATE_REPLY)
        return self.silent or bool(self.lost)
