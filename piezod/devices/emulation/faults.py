"""What goes wrong on the wire of an emulated device, on purpose.

A fault is written `KIND[:WHICH][:VALUE]`.

WHICH replies it befalls, which are counted from 1: `7`, `7-9`, `7-` (that one and all after it),
`every 7` (the 7th, the 14th, …); left out: every one. `now` is at once, whether there is a reply or
not, for the kinds that befall the device rather than a reply: those that have it be away.

VALUE is a number, or a range like `0.01-0.2` from which one is drawn each time.
"""

import random
import re
from collections.abc import Iterable
from enum import StrEnum
from threading import Lock
from typing import Final, NamedTuple


class WireFaultKind(StrEnum):
    """What goes wrong."""

    LATE = "late"
    """The reply comes VALUE seconds late, and those after it not before it."""
    LOST = "lost"
    """The reply never comes."""
    GARBLED = "garbled"
    """Bit VALUE of the reply is flipped, counted from 0; left out: any."""
    PARTIAL = "partial"
    """Only the first VALUE bytes of the reply come; left out: half of it."""
    DUPLICATED = "duplicated"
    """The reply comes twice."""
    NOISE = "noise"
    """VALUE random bytes come before the reply; left out: 8."""
    DISCONNECT = "disconnect"
    """The connection goes, and comes back VALUE seconds later; left out: 0.5."""
    IMPOSTOR = "wrong-identity"
    """Likewise, and what comes back is a device with another serial number."""
    RESTART = "restart"
    """The device is off for VALUE seconds, then as after power-up, at 0 V; left out: 0.5."""
    FOREIGN = "foreign"
    """On a CAN bus: somebody else sends a frame of the host's before this one."""
    BUS_OFF = "bus-off"
    """On a CAN bus: for VALUE seconds no frame goes either way; left out: 0.5."""


BEFALL_DEVICE: Final = frozenset(
    {
        WireFaultKind.DISCONNECT,
        WireFaultKind.IMPOSTOR,
        WireFaultKind.RESTART,
        WireFaultKind.BUS_OFF,
    },
)
"""What can happen at once, and not only in place of a reply."""
ON_A_BUS: Final = frozenset({WireFaultKind.FOREIGN, WireFaultKind.BUS_OFF})
"""What cannot happen on a wire with nobody else on it."""

_USUAL: Final = {
    WireFaultKind.NOISE: 8.0,
    WireFaultKind.DISCONNECT: 0.5,
    WireFaultKind.IMPOSTOR: 0.5,
    WireFaultKind.RESTART: 0.5,
    WireFaultKind.BUS_OFF: 0.5,
}
_MOST_VALUE: Final = 3600.0
_WHICH: Final = re.compile(
    r"(?P<now>now)|every +(?P<every>\d{1,9})|(?P<a>\d{1,9})(?P<to>-(?P<b>\d{1,9})?)?"
)
_VALUE: Final = re.compile(r"(\d{1,6}(?:\.\d{1,9})?)(?:-(\d{1,6}(?:\.\d{1,9})?))?")


class WireFault(NamedTuple):
    """One thing that goes wrong.

    Attributes:
        kind: What.
        first: The first reply that it befalls, counted from 1; 0 for at once.
        last: The last one, None for no end.
        every: It befalls only those whose number can be divided by this.
        value: Range of its value; None for the usual.
    """

    kind: WireFaultKind
    first: int = 1
    last: int | None = None
    every: int = 1
    value: tuple[float, float] | None = None

    def befalls(self, number: int) -> bool:
        """Tell whether it befalls a reply."""
        in_range = 0 < self.first <= number and (self.last is None or number <= self.last)
        return in_range and number % self.every == 0


class ActiveFault(NamedTuple):
    """A fault that happens now.

    Attributes:
        kind: What.
        value: Its value; None where it is any.
    """

    kind: WireFaultKind
    value: float | None


class ReplyFate(NamedTuple):
    """What becomes of a reply.

    Attributes:
        late_ns: How late it comes.
        noise: Bytes that come before it, as late.
        copies: Its bytes, as often as it comes.
    """

    late_ns: int
    noise: bytes
    copies: list[bytes]


def parse(text: str) -> WireFault:
    """Return the fault that a text stands for; the syntax is at the top of this file.

    Raises:
        ValueError: If it stands for none; the text says why.
    """
    kind_text, *parts = text.split(":")
    if kind_text not in list(WireFaultKind):
        raise ValueError(
            f"no fault {kind_text!r} (got {text!r}), known: {', '.join(WireFaultKind)}"
        )
    kind = WireFaultKind(kind_text)
    if len(parts) > 2:
        raise ValueError(f"too many parts in {text!r}, expected KIND[:WHICH][:VALUE]")
    fault = _with_which(WireFault(kind), parts[0], text) if parts else WireFault(kind)
    if len(parts) == 2:
        fault = fault._replace(value=_value(parts[1], text))
    if kind == WireFaultKind.LATE and fault.value is None:
        raise ValueError(f"how late, in s? as in late:1-10:0.05 (got {text!r})")
    return fault


def _with_which(fault: WireFault, which: str, text: str) -> WireFault:
    found = _WHICH.fullmatch(which)
    if found is None:
        what = "7, 7-9, 7-, every 7, or now"
        raise ValueError(f"no reply is called {which!r} in {text!r}, expected {what}")
    if found["now"]:
        if fault.kind not in BEFALL_DEVICE:
            raise ValueError(f"{fault.kind} befalls a reply, not a device at once (got {text!r})")
        return fault._replace(first=0, last=0)
    if found["every"]:
        every = int(found["every"])
        if not every:
            raise ValueError(f"every 0th reply is none (got {text!r})")
        return fault._replace(every=every)
    first = int(found["a"])
    last = int(found["b"]) if found["b"] else None if found["to"] else first
    if first < 1 or (last is not None and last < first):
        raise ValueError(f"replies are counted from 1, and upwards (got {text!r})")
    return fault._replace(first=first, last=last)


def _value(value: str, text: str) -> tuple[float, float]:
    found = _VALUE.fullmatch(value)
    low, high = (float(found[1]), float(found[2] or found[1])) if found else (1.0, 0.0)
    if not low <= high <= _MOST_VALUE:
        what = f"a number or a range, 0 to {_MOST_VALUE:g}, as in 0.05 or 0.01-0.2"
        raise ValueError(f"no value {value!r} in {text!r}, expected {what}")
    return low, high


class WireFaults:
    """What goes wrong on one wire; may be changed by another thread.

    Args:
        faults: What goes wrong.
    """

    def __init__(self, faults: Iterable[WireFault] = ()) -> None:
        self._random = random.Random(1)  # noqa: S311 - faults that can be repeated
        self._lock = Lock()
        self.set(faults)

    def set(self, faults: Iterable[WireFault]) -> None:
        """Have this go wrong from now on, and nothing else; the next reply is number 1."""
        with self._lock:
            self._faults, self._number = list(faults), 0
            self._at_once = [fault for fault in self._faults if not fault.first]

    def next_reply(self) -> list[ActiveFault]:
        """Count a reply, or a frame, and tell what befalls it."""
        with self._lock:
            self._number += 1
            return [self._hit(fault) for fault in self._faults if fault.befalls(self._number)]

    def at_once(self) -> list[ActiveFault]:
        """Tell once what happens now."""
        with self._lock:
            hits, self._at_once = [self._hit(fault) for fault in self._at_once], []
            return hits

    def fate(self, data: bytes, hits: Iterable[ActiveFault]) -> ReplyFate:
        """Tell what becomes of a reply, or of the data of a frame, that this befalls."""
        late_s, noise, copies = 0.0, b"", 1
        for kind, value in hits:
            match kind:
                case WireFaultKind.LATE:
                    late_s += value or 0.0
                case WireFaultKind.LOST:
                    copies = 0
                case WireFaultKind.DUPLICATED:
                    copies *= 2
                case WireFaultKind.GARBLED:
                    data = self._garbled(data, value)
                case WireFaultKind.PARTIAL:
                    data = data[: len(data) // 2 if value is None else int(value)]
                case WireFaultKind.NOISE:
                    noise += self._random.randbytes(int(value or 0))
                case _:
                    pass  # befalls the device, or the bus
        return ReplyFate(round(late_s * 1e9), noise, [data] * copies)

    def _garbled(self, data: bytes, bit: float | None) -> bytes:
        n_bits = 8 * len(data)
        if not n_bits:
            return data
        place = self._random.randrange(n_bits) if bit is None else int(bit) % n_bits
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        return bytes(flipped)

    def _hit(self, fault: WireFault) -> ActiveFault:
        if fault.value is None:
            return ActiveFault(fault.kind, _USUAL.get(fault.kind))
        return ActiveFault(fault.kind, self._random.uniform(*fault.value))
