"""The driver's end of the socket, with rigs that reply late, wrongly or not at all."""

import re
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from piezod.devices.interface import Identity
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.emulated.codec import (
    Greeting,
    Op,
    RigCodec,
    RigReply,
    RigRequest,
    pack_greeting,
    pack_refusal,
)
from piezod_drivers.emulated.emulator import listening
from piezod_drivers.emulated.session import RigSession
from tests.drivers.emulated_bench import serving

GREETING = Greeting(Identity("piezod", "scripted", "1", "1"), ("x",), 1e3, "first")
CODEC = RigCodec(1)


class ScriptedRig:
    """A rig that a test controls, in the test's thread: the kernel buffers the packets."""

    def __init__(self, listener: socket.socket) -> None:
        listener.settimeout(10.0)
        self._listener = listener
        self._client: socket.socket | None = None

    def hang_up(self) -> None:
        """Disconnect the driver."""
        if self._client is not None:
            self._client.close()

    def accept(self, packet: bytes) -> None:
        """Accept the driver with a packet."""
        self.hang_up()
        self._client, _ = self._listener.accept()
        self._client.send(packet)

    def send(self, *replies: bytes) -> None:
        """Send replies."""
        assert self._client is not None
        for reply in replies:
            self._client.send(reply)

    def received(self) -> list[int]:
        """Read the pending requests and return their numbers."""
        assert self._client is not None
        self._client.setblocking(False)
        numbers = []
        try:
            while packet := self._client.recv(1000):
                request = CODEC.unpack_request(packet)
                assert request is not None
                numbers.append(request.number)
        except BlockingIOError:
            pass
        return numbers


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of the rig's socket."""
    return tmp_path / "rig.sock"


@pytest.fixture
def rig(path: Path) -> Iterator[ScriptedRig]:
    """Return a rig that has not accepted a driver."""
    with listening(path) as listener:
        rig = ScriptedRig(listener)
        yield rig
        rig.hang_up()


@contextmanager
def accepting(rig: ScriptedRig, packet: bytes) -> Iterator[None]:
    """Accept a driver that connects in the block."""
    thread = threading.Thread(target=rig.accept, args=(packet,))
    thread.start()
    yield
    thread.join()


@pytest.fixture
def link(path: Path, rig: ScriptedRig) -> Iterator[RigSession]:
    """Return a connected session with a short deadline."""
    link = RigSession(path, 0.02)
    with accepting(rig, pack_greeting(GREETING)):
        link.connect()
    yield link
    link.close()


def request(number: int) -> RigRequest:
    """Return a request."""
    return RigRequest(Op.READ, number, number, [0.0])


def reply(number: int, position_um: float = 0.0) -> bytes:
    """Return the packet of a reply."""
    return CODEC.pack_reply(RigReply(number, True, [True], [position_um], [0.0]))


def test_answer_in_time_is_given(link: RigSession, rig: ScriptedRig) -> None:
    """The numbers of a reply arrive unchanged."""
    rig.send(reply(1, 1.25))

    assert link.exchange(request(1)) == RigReply(1, True, [True], [1.25], [0.0])


@pytest.mark.fault("B5")
def test_late_answer_is_not_taken_for_another(link: RigSession, rig: ScriptedRig) -> None:
    """A late reply is dropped, and the next ones belong to their requests."""
    first = link.exchange(request(1))
    rig.send(reply(1, 1.0), reply(2, 2.0))
    second = link.exchange(request(2))
    rig.send(reply(3, 3.0))
    third = link.exchange(request(3))

    assert first is None
    assert second is not None
    assert third is not None
    assert (second.position_um, third.position_um) == ([2.0], [3.0])


def test_stalled_rig_gets_no_queue(link: RigSession, rig: ScriptedRig) -> None:
    """No request is sent while one has no reply, so no old voltages are queued."""
    for number in range(1, 10):
        assert link.exchange(request(number)) is None

    assert rig.received() == [1]


def test_reply_of_another_shape_is_none(link: RigSession, rig: ScriptedRig) -> None:
    """An invalid reply counts as none."""
    rig.send(b"what?")

    assert link.exchange(request(1)) is None


def test_rig_that_hangs_up_is_lost(link: RigSession, rig: ScriptedRig) -> None:
    """After the rig has disconnected there is no reply."""
    rig.hang_up()

    assert link.exchange(request(1)) is None
    assert link.exchange(request(2)) is None


def test_lost_rig_is_looked_for_now_and_then(path: Path, rig: ScriptedRig) -> None:
    """A lost rig is tried again after 0.1 s, and used when it accepts."""
    with closing(
        RigSession(path, 10.0)
    ) as link:  # a thread that has just started sends the greeting
        with accepting(rig, pack_greeting(GREETING)):
            link.connect()
        rig.hang_up()
        link.exchange(request(1))
        with accepting(rig, pack_refusal("used")):
            link.reconnect(GREETING, 200_000_000)
        link.reconnect(GREETING, 250_000_000)
        with accepting(rig, pack_greeting(GREETING._replace(run_id="second"))):
            link.reconnect(GREETING, 300_000_000)
        rig.send(reply(2))

        assert link.exchange(request(2)) is not None
        assert link.run_id == "second"


@pytest.mark.parametrize(
    ("greeting", "text"),
    [
        (b"", "not the greeting of a rig: b''"),
        (b"hello", "not the greeting of a rig: b'hello'"),
        (b"[1]", "not the greeting of a rig"),
        (b'{"protocol": 1}', "not the greeting of a rig"),
        (b'{"protocol": 2, "greeting": []}', "uses protocol 2, not 1"),
        (pack_refusal("used by process 7"), "refuses: used by process 7"),
    ],
)
def test_strange_greeting_is_refused(
    path: Path, rig: ScriptedRig, greeting: bytes, text: str
) -> None:
    """An invalid greeting is refused with the reason."""
    with accepting(rig, greeting), pytest.raises(DeviceError, match=re.escape(text)):
        RigSession(path, 1.0).connect()


def test_rig_without_a_greeting_is_unavailable(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rig without a greeting is not waited for longer than the time-out."""
    monkeypatch.setattr("piezod_drivers.emulated.session._GREETING_S", 0.01)
    with listening(path), pytest.raises(DeviceUnavailableError, match="timed out"):
        RigSession(path, 1.0).connect()


@pytest.mark.parametrize("packet", [b"what?", b""])
def test_server_hangs_up_on_what_is_no_driver(path: Path, packet: bytes) -> None:
    """The server disconnects a client that is no driver, and serves the next one."""
    with serving(path):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
            stranger.settimeout(10.0)
            stranger.connect(str(path))
            stranger.recv(1000)
            stranger.send(packet)
            end = stranger.recv(1000)
        link = RigSession(path, 1.0)
        link.connect()
        link.close()

    assert end == b""


@pytest.mark.parametrize("asking", [True, False])
def test_server_survives_a_client_that_does_not_read(path: Path, *, asking: bool) -> None:
    """A driver that is killed during an exchange leaves the rig to the next one."""
    with serving(path):
        for _ in range(20):
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as killed:
                killed.connect(str(path))
                if asking:
                    killed.send(CODEC.pack_request(request(1)))
        link = RigSession(path, 1.0)
        link.connect()
        link.close()
