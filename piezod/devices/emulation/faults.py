"""Wire faults: errors that an emulated device makes on purpose.

A fault is written `KIND[:WHICH][:VALUE]`.

WHICH selects replies, counted from 1: `7`, `7-9`, `7-` (this one and all later ones), `every 7`
(the 7th, the 14th, …); without it, every reply. `now` means at once, without a reply; it is for the
kinds that affect the device, not a reply: those that make it absent.

VALUE is a number, or a range like `0.01-0.2` from which a number is drawn each time.
"""

import random
import re
from collections.abc import Iterable
from enum import StrEnum
from threading import Lock
from typing import Final, NamedTuple


class WireFaultKind(StrEnum):
    """Kind of a wire fault."""

    LATE = "late"
    """The reply comes VALUE seconds late; later replies do not overtake it."""
    LOST = "lost"
    """The reply never comes."""
    GARBLED = "garbled"
    """Bit VALUE of the reply, counted from 0, is flipped; default: a random bit."""
    PARTIAL = "partial"
    """Only the first VALUE bytes of the reply come; default: half of it."""
    DUPLICATED = "duplicated"
    """The reply comes twice."""
    NOISE = "noise"
    """VALUE random bytes come before the reply; default: 8."""
    DISCONNECT = "disconnect"
    """The connection is lost for VALUE seconds; default: 0.5."""
    IMPOSTOR = "wrong-identity"
    """Like `disconnect`, but then a device with another serial number is connected."""
    RESTART = "restart"
    """The device is off for VALUE seconds, then as after power-up, at 0 V; default: 0.5."""
    FOREIGN = "foreign"
    """On a CAN bus: another node sends a frame with the host's identifier before this one."""
    BUS_OFF = "bus-off"
    """On a CAN bus: for VALUE seconds no frame passes in either direction; default: 0.5."""


DEVICE_KINDS: Final = frozenset(
    {
        WireFaultKind.DISCONNECT,
        WireFaultKind.IMPOSTOR,
        WireFaultKind.RESTART,
        WireFaultKind.BUS_OFF,
    },
)
"""Kinds that affect the device; they can also happen at once, without a reply."""
ON_A_BUS: Final = frozenset({WireFaultKind.FOREIGN, WireFaultKind.BUS_OFF})
"""Kinds that need a bus; on a wire there is no other node."""

_DEFAULT_VALUES: Final = {
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
    """One wire fault."""

    kind: WireFaultKind  #: Kind of the fault.
    first: int = 1  #: First affected reply, counted from 1; 0 for at once.
    last: int | None = None  #: Last affected reply; None for no end.
    every: int = 1  #: Only replies whose number is a multiple of this are affected.
    value: tuple[float, float] | None = None  #: Range of its value; None for the default.

    def affects(self, number: int) -> bool:
        """Return whether it affects the reply of this number."""
        in_range = 0 < self.first <= number and (self.last is None or number <= self.last)
        return in_range and number % self.every == 0


class ActiveFault(NamedTuple):
    """A fault that happens now."""

    kind: WireFaultKind  #: Kind of the fault.
    value: float | None  #: Its value; None for a random one.


class ReplyFate(NamedTuple):
    """Effect of wire faults on one reply."""

    late_ns: int  #: Delay of the reply, in ns.
    noise: bytes  #: Bytes before it, with the same delay.
    copies: list[bytes]  #: Bytes of the reply, once per copy.


def parse(text: str) -> WireFault:
    """Return the fault that a text describes; the module docstring gives the syntax.

    Raises:
        ValueError: If the text describes none; the message states the reason.
    """
    kind_text, *parts = text.split(":")
    if kind_text not in list(WireFaultKind):
        raise ValueError(
            f"unknown fault {kind_text!r} in {text!r}, known: {', '.join(WireFaultKind)}"
        )
    kind = WireFaultKind(kind_text)
    if len(parts) > 2:
        raise ValueError(f"too many parts in {text!r}, expected KIND[:WHICH][:VALUE]")
    fault = _with_which(WireFault(kind), parts[0], text) if parts else WireFault(kind)
    if len(parts) == 2:
        fault = fault._replace(value=_value(parts[1], text))
    if kind == WireFaultKind.LATE and fault.value is None:
        raise ValueError(f"{text!r} needs a delay in s, as in late:1-10:0.05")
    return fault


def _with_which(fault: WireFault, which: str, text: str) -> WireFault:
    found = _WHICH.fullmatch(which)
    if found is None:
        what = "7, 7-9, 7-, every 7, or now"
        raise ValueError(f"{which!r} selects no reply in {text!r}, expected {what}")
    if found["now"]:
        if fault.kind not in DEVICE_KINDS:
            raise ValueError(f"{fault.kind} affects replies, it cannot happen now (got {text!r})")
        return fault._replace(first=0, last=0)  # no reply has the number 0
    if found["every"]:
        every = int(found["every"])
        if not every:
            raise ValueError(f"every needs a number of at least 1 (got {text!r})")
        return fault._replace(every=every)
    first = int(found["a"])
    last = int(found["b"]) if found["b"] else None if found["to"] else first
    if first < 1 or (last is not None and last < first):
        raise ValueError(f"replies are counted from 1, in rising order (got {text!r})")
    return fault._replace(first=first, last=last)


def _value(value: str, text: str) -> tuple[float, float]:
    found = _VALUE.fullmatch(value)
    # Without a match the range is the wrong way round, so that one test refuses both.
    low, high = (float(found[1]), float(found[2] or found[1])) if found else (1.0, 0.0)
    if not low <= high <= _MOST_VALUE:
        what = f"a number or a range, 0 to {_MOST_VALUE:g}, as in 0.05 or 0.01-0.2"
        raise ValueError(f"invalid value {value!r} in {text!r}, expected {what}")
    return low, high


class WireFaults:
    """Faults of one wire; thread-safe."""

    def __init__(self, faults: Iterable[WireFault] = ()) -> None:
        self._random = random.Random(1)  # noqa: S311 - the faults must be reproducible
        self._lock = Lock()
        self.set(faults)

    def set(self, faults: Iterable[WireFault]) -> None:
        """Replace all faults; the next reply is number 1."""
        with self._lock:
            self._faults, self._number = list(faults), 0
            # Faults that happen now have `first` 0, see `_with_which`.
            self._at_once = [fault for fault in self._faults if not fault.first]

    def next_reply(self) -> list[ActiveFault]:
        """Count a reply, or a frame, and return the faults that affect it."""
        with self._lock:
            self._number += 1
            return [self._activated(fault) for fault in self._faults if fault.affects(self._number)]

    def at_once(self) -> list[ActiveFault]:
        """Return the faults that happen now, once."""
        with self._lock:
            hits, self._at_once = [self._activated(fault) for fault in self._at_once], []
            return hits

    def fate(self, data: bytes, hits: Iterable[ActiveFault]) -> ReplyFate:
        """Return the effect of these faults on a reply, or on the data of a frame."""
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
                    pass  # affects the device or the bus, not this reply
        return ReplyFate(round(late_s * 1e9), noise, [data] * copies)

    def _garbled(self, data: bytes, bit: float | None) -> bytes:
        n_bits = 8 * len(data)
        if not n_bits:
            return data
        place = self._random.randrange(n_bits) if bit is None else int(bit) % n_bits
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        return bytes(flipped)

    def _activated(self, fault: WireFault) -> ActiveFault:
        if fault.value is None:
            return ActiveFault(fault.kind, _DEFAULT_VALUES.get(fault.kind))
        return ActiveFault(fault.kind, self._random.uniform(*fault.value))
