"""The rig's end of the socket, which serves one client at a time."""

import secrets
import selectors
import socket
from collections.abc import Callable
from math import isfinite, nan
from struct import Struct
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Identity
from piezod_drivers.emulated.codec import (
    MAX_PACKET,
    Greeting,
    Op,
    RigCodec,
    RigReply,
    RigRequest,
    pack_greeting,
    pack_refusal,
)

_TICK_S: Final = 0.01  # longest time without a step of the physics, which then has to catch up
_PEER: Final = Struct("3i")  # of SO_PEERCRED: pid, uid, gid


def _ignore(_asked_ns: int) -> None:
    """Do nothing with the instant of a call."""


class RigServer:
    """Serves a rig; a client that disconnects changes nothing.

    Args:
        identity: Identity that it reports.
        listener: A listening socket of type SOCK_SEQPACKET.
        on_call: Called with the instant of each call, before it is carried out.
    """

    def __init__(
        self,
        bench: SharedRig,
        identity: Identity,
        listener: socket.socket,
        on_call: Callable[[int], None] = _ignore,
    ) -> None:
        self._bench, self._listener, self._on_call = bench, listener, on_call
        self._codec = RigCodec(bench.n_axes)
        run_id = secrets.token_hex(8)
        self._greeting = pack_greeting(Greeting(identity, bench.axes, bench.max_rate_hz, run_id))
        self._selector = selectors.DefaultSelector()
        self._client: socket.socket | None = None
        self._client_pid = 0

    def serve(self, stopping: Callable[[], bool]) -> None:
        """Serve until `stopping` returns True; the rig stays as it is.

        Args:
            stopping: Called at least every 10 ms; returns whether to stop.
        """
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
        try:
            while not stopping():
                for key, _ in self._selector.select(_TICK_S):
                    key.data()
                # The physics also advances without calls.
                self._bench.tick()
        finally:
            self._drop()
            self._selector.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if self._client is not None:
            self._answer()  # the present client may just have disconnected
        with_pid = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        # The kernel knows the process, so a client cannot claim another one.
        pid = _PEER.unpack(with_pid)[0]
        if self._client is not None:
            _send(client, pack_refusal(f"it is used by process {self._client_pid}"))
            client.close()
            return
        # A client that does not read its replies must not stop the physics.
        client.setblocking(False)
        self._client, self._client_pid = client, pid
        self._selector.register(client, selectors.EVENT_READ, self._answer)
        _send(client, self._greeting)

    def _answer(self) -> None:
        """Reply to the one request that a client may have sent."""
        if self._client is None:
            return
        try:
            packet = self._client.recv(MAX_PACKET)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        request = self._codec.unpack_request(packet)
        # No request: the client has disconnected, or is no driver.
        if request is None or not _send(self._client, self._run(request)):
            self._drop()

    def _run(self, request: RigRequest) -> bytes:
        op, number, asked_ns, drive_v = request
        self._on_call(asked_ns)
        taken, position_um = True, [nan] * self._bench.n_axes
        if op == Op.READ:
            position_um = self._bench.positions_um()
        elif op == Op.WRITE:
            taken = self._bench.drive_all(drive_v, asked_ns, self._client_pid)
        valid = [isfinite(each_um) for each_um in position_um]
        # After the call, so that a reply to a write has the voltages that it has set.
        in_force_v = self._bench.drives_v()
        return self._codec.pack_reply(RigReply(number, taken, valid, position_um, in_force_v))

    def _drop(self) -> None:
        if self._client is not None:
            self._selector.unregister(self._client)
            self._client.close()
            self._client = None


def _send(client: socket.socket, packet: bytes) -> bool:
    """Send a packet; return whether it was sent."""
    try:
        client.send(packet)
    except OSError:
        return False
    return True
