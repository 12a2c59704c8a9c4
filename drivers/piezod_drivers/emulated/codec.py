"""What goes over the socket: a greeting when the rig accepts, then a packet each way for each call.

A socket of type SOCK_SEQPACKET keeps packets apart. Both ends are on one machine, so numbers are as
that machine has them. Every answer carries the number of its request: one that comes too late is
not taken for another.
"""

import json
from collections.abc import Sequence
from enum import IntEnum
from struct import Struct, error
from typing import Any, Final, NamedTuple

from piezod.devices.interface import Identity
from piezod.errors import DeviceError

MAX_PACKET: Final = 65_536
_PROTOCOL: Final = 1


class Op(IntEnum):
    """What is asked of the rig."""

    READ = 1
    WRITE = 2
    READ_BACK = 3


class RigRequest(NamedTuple):
    """One call.

    Attributes:
        op: What is asked.
        number: Of this request, from 0 to 2³² - 1.
        now_ns: The caller's instant.
        drive_v: One voltage per axis, in V; without meaning unless `op` is `WRITE`.
    """

    op: int
    number: int
    now_ns: int
    drive_v: Sequence[float]


class RigReply(NamedTuple):
    """What the rig answers to a call.

    Attributes:
        number: Of the request.
        taken: Whether it was carried out.
        valid: Per axis, whether the position may be used; False unless it was asked for.
        position_um: Measured displacement per axis, in µm.
        in_force_v: Output of the amplifier per axis after the call, in V.
    """

    number: int
    taken: bool
    valid: Sequence[bool]
    position_um: Sequence[float]
    in_force_v: Sequence[float]


class Wire:
    """Packets for a number of axes. Every method may be called in the loop.

    Args:
        n_axes: Number of axes.
    """

    def __init__(self, n_axes: int) -> None:
        self._n = n_axes
        self._request = Struct(f"=BIq{n_axes}d")
        self._reply = Struct(f"=I?{n_axes}?{n_axes}d{n_axes}d")

    def pack_request(self, request: RigRequest) -> bytes:
        """Return the packet of a request."""
        op, number, now_ns, drive_v = request
        return self._request.pack(op, number, now_ns, *drive_v)

    def unpack_request(self, packet: bytes) -> RigRequest | None:
        """Return the request in a packet, None where there is none."""
        try:
            op, number, now_ns, *drive_v = self._request.unpack(packet)
        except error:
            return None
        return RigRequest(op, number, now_ns, drive_v)

    def pack_reply(self, reply: RigReply) -> bytes:
        """Return the packet of a reply."""
        number, taken, valid, position_um, in_force_v = reply
        return self._reply.pack(number, taken, *valid, *position_um, *in_force_v)

    def unpack_reply(self, packet: bytes) -> RigReply | None:
        """Return the reply in a packet, None where there is none."""
        try:
            number, taken, *values = self._reply.unpack(packet)
        except error:
            return None
        n = self._n
        return RigReply(number, taken, values[:n], values[n : 2 * n], values[2 * n :])


class Greeting(NamedTuple):
    """What the rig tells whom it accepts.

    Attributes:
        identity: Who it is.
        axes: Names of its axes.
        max_rate_hz: The fastest loop that it can follow.
        life: Something else after each start of the rig.
    """

    identity: Identity
    axes: tuple[str, ...]
    max_rate_hz: float
    life: str


def pack_greeting(greeting: Greeting) -> bytes:
    """Return the packet of a greeting."""
    return json.dumps({"protocol": _PROTOCOL, "greeting": greeting}).encode()


def pack_refusal(why: str) -> bytes:
    """Return the packet that is sent instead of a greeting."""
    return json.dumps({"protocol": _PROTOCOL, "refused": why}).encode()


def unpack_greeting(packet: bytes) -> Greeting | str:
    """Return the greeting in a packet, or why the rig refuses.

    Raises:
        DeviceError: If it is neither.
    """
    try:
        document: dict[str, Any] = json.loads(packet)
        if document["protocol"] != _PROTOCOL:
            raise DeviceError(f"the rig speaks protocol {document['protocol']}, not {_PROTOCOL}")
        if "refused" in document:
            return str(document["refused"])
        identity, axes, max_rate_hz, life = document["greeting"]
        return Greeting(Identity(*identity), tuple(axes), max_rate_hz, life)
    except (ValueError, KeyError, TypeError) as problem:
        raise DeviceError(f"what answers is no rig: {packet[:80]!r}") from problem
