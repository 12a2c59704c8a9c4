"""The rig's end of the socket: a device, served to one client at a time."""

import secrets
import selectors
import socket
from collections.abc import Callable
from math import nan
from struct import Struct
from typing import Final, Protocol

from piezod.devices.emulation.trace import Trace
from piezod.devices.interface import Amplifier, Identity, Sensor
from piezod_drivers.emulated.wire import (
    MAX_PACKET,
    Greeting,
    Op,
    Reply,
    Request,
    Wire,
    pack_greeting,
    pack_refusal,
)

_TICK_S: Final = 0.01  # how long the physics may be left alone: it would have to catch up at once
_PEER: Final = Struct("3i")  # pid, uid, gid


class Rig(Sensor, Amplifier, Protocol):
    """A device that is sensor and amplifier in one."""


class RigServer:
    """Serves a device that it activates and keeps; a client that goes changes nothing.

    Args:
        rig: The device, open and not active.
        identity: Who it said it is.
        listener: A socket of type SOCK_SEQPACKET at which clients can connect.
        time_of: Tells the rig's time when a call arrives that carries this instant. It never goes
            back. A clock that ignores what it is told makes physics in real time.
        trace: Told every write that is taken.
    """

    def __init__(
        self,
        rig: Rig,
        identity: Identity,
        listener: socket.socket,
        time_of: Callable[[int], int],
        trace: Trace | None = None,
    ) -> None:
        self._rig, self._listener, self._time_of, self._trace = rig, listener, time_of, trace
        able = rig.capabilities()
        self._axes = able.outputs
        self._wire = Wire(len(self._axes))
        life = secrets.token_hex(8)
        self._greeting = pack_greeting(Greeting(identity, self._axes, able.max_rate_hz, life))
        self._selector = selectors.DefaultSelector()
        self._client: socket.socket | None = None
        self._client_pid = 0
        self._asked_ns = 0

    def serve(self, stopping: Callable[[], bool]) -> None:
        """Serve until told to stop, then leave the rig as it is.

        Args:
            stopping: Asked at least every 10 ms.
        """
        self._rig.activate(self._time_of(self._asked_ns))
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
        try:
            while not stopping():
                for key, _ in self._selector.select(_TICK_S):
                    key.data()
                self._rig.read_back(self._time_of(self._asked_ns))
        finally:
            self._drop()
            self._selector.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if self._client is not None:
            self._answer()  # the one before may have just gone
        with_pid = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        pid = _PEER.unpack(with_pid)[0]
        if self._client is not None:
            _send(client, pack_refusal(f"it is used by process {self._client_pid}"))
            client.close()
            return
        client.setblocking(False)
        self._client, self._client_pid = client, pid
        self._selector.register(client, selectors.EVENT_READ, self._answer)
        _send(client, self._greeting)

    def _answer(self) -> None:
        """Answer the one request that a client may have made."""
        if self._client is None:
            return
        try:
            packet = self._client.recv(MAX_PACKET)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        request = self._wire.unpack_request(packet)
        # No request: the client has gone, or is no driver.
        if request is None or not _send(self._client, self._carry_out(request)):
            self._drop()

    def _carry_out(self, request: Request) -> bytes:
        op, number, asked_ns, drive_v = request
        self._asked_ns = asked_ns
        t_ns = self._time_of(asked_ns)
        n = len(self._axes)
        taken, valid, position_um = True, [False] * n, [nan] * n
        if op == Op.READ:
            samples = self._rig.read(t_ns)
            valid = [sample.valid for sample in samples]
            position_um = [sample.position_um for sample in samples]
        elif op == Op.WRITE:
            taken = self._rig.write(drive_v, t_ns)
            if taken and self._trace is not None:
                self._trace.add(t_ns, asked_ns, self._client_pid, drive_v)
        in_force_v = self._rig.read_back(t_ns)
        return self._wire.pack_reply(Reply(number, taken, valid, position_um, in_force_v))

    def _drop(self) -> None:
        if self._client is not None:
            self._selector.unregister(self._client)
            self._client.close()
            self._client = None


def _send(client: socket.socket, packet: bytes) -> bool:
    """Send a packet; tell whether it went."""
    try:
        client.send(packet)
    except OSError:
        return False
    return True
