"""Packets over the socket: a greeting when the rig accepts, then one each way per call.

A socket of type SOCK_SEQPACKET keeps packets apart. Both ends are on one machine, so numbers have
its native format. Each reply repeats the number of its request, so a late reply is not taken for
another one.
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
    """Calls of the rig."""

    READ = 1
    WRITE = 2
    READ_BACK = 3


class RigRequest(NamedTuple):
    """A call."""

    op: int  #: Kind of the call.
    number: int  #: Number of this request, from 0 to 2³² - 1.
    now_ns: int  #: The caller's instant.
    drive_v: Sequence[float]  #: One voltage per axis, in V; without meaning unless `op` is `WRITE`.


class RigReply(NamedTuple):
    """The reply to a call."""

    number: int  #: Number of the request.
    taken: bool  #: Whether the call was carried out.
    #: Per axis, whether the position may be used; False unless it was requested.
    valid: Sequence[bool]
    position_um: Sequence[float]  #: Measured displacement per axis, in µm.
    in_force_v: Sequence[float]  #: Output of the amplifier per axis after the call, in V.


class RigCodec:
    """Packets for a number of axes. Real-time safe."""

    def __init__(self, n_axes: int) -> None:
        self._n = n_axes
        # "=": native byte order without padding; both ends are on one machine.
        self._request = Struct(f"=BIq{n_axes}d")
        self._reply = Struct(f"=I?{n_axes}?{n_axes}d{n_axes}d")

    def pack_request(self, request: RigRequest) -> bytes:
        """Return the packet of a request."""
        op, number, now_ns, drive_v = request
        return self._request.pack(op, number, now_ns, *drive_v)

    def unpack_request(self, packet: bytes) -> RigRequest | None:
        """Return the request in a packet, None if there is none."""
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
        """Return the reply in a packet, None if there is none."""
        try:
            number, taken, *values = self._reply.unpack(packet)
        except error:
            return None
        n = self._n
        return RigReply(number, taken, values[:n], values[n : 2 * n], values[2 * n :])


class Greeting(NamedTuple):
    """The rig's first packet to a client that it accepts."""

    identity: Identity  #: Identity of the rig.
    axes: tuple[str, ...]  #: Names of its axes.
    max_rate_hz: float  #: Highest rate of a loop.
    run_id: str  #: Different after each start of the rig.


def pack_greeting(greeting: Greeting) -> bytes:
    """Return the packet of a greeting."""
    return json.dumps({"protocol": _PROTOCOL, "greeting": greeting}).encode()


def pack_refusal(why: str) -> bytes:
    """Return the packet that replaces a greeting."""
    return json.dumps({"protocol": _PROTOCOL, "refused": why}).encode()


def unpack_greeting(packet: bytes) -> Greeting | str:
    """Return the greeting in a packet, or the reason of a refusal.

    Raises:
        DeviceError: If it is neither.
    """
    try:
        document: dict[str, Any] = json.loads(packet)
        if document["protocol"] != _PROTOCOL:
            raise DeviceError(f"the rig uses protocol {document['protocol']}, not {_PROTOCOL}")
        if "refused" in document:
            return str(document["refused"])
        identity, axes, max_rate_hz, run_id = document["greeting"]
        return Greeting(Identity(*identity), tuple(axes), max_rate_hz, run_id)
    except (ValueError, KeyError, TypeError) as problem:
        raise DeviceError(f"not the greeting of a rig: {packet[:80]!r}") from problem
