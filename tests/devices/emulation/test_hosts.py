"""Emulated devices at a pty and a TCP port, served by threads of this process."""

import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from piezod.devices import emulators
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.emulation.faults import WireFaults, parse
from piezod.devices.emulation.places import address, make_own_folder
from piezod.devices.emulators import Emulation, EmulationRequest
from piezod.errors import DeviceError, DeviceUnavailableError, RegistryError
from tests.daemon.waiting import eventually
from tests.drivers.bus.wire import StillRig

LONG_NS = 5_000_000_000
HOUR_NS = 3600 * 1_000_000_000


class Parrot:
    """An emulator that repeats its serial number and all bytes since the last connection."""

    def __init__(self, bench: SharedRig, serial: str) -> None:
        self._bench, self._serial, self._heard, self._unasked = bench, serial, b"", b""

    def receive(self, data: bytes) -> list[bytes]:
        self._heard += data
        if data == b"later":
            self._unasked = b"unasked"
        if data == b"drive":
            self._bench.drive_all([1.0] * self._bench.n_axes)
        return [self._serial.encode() + b":" + self._heard]

    def due(self) -> list[bytes]:
        unasked, self._unasked = self._unasked, b""
        return [unasked] if unasked else []

    def connected(self) -> None:
        self._heard = b""


SERIAL = EmulatorPlugin("parrot", "a parrot", "serial", Parrot)
TCP = EmulatorPlugin("parrot", "a parrot", "tcp", Parrot)


class Clock:
    """The clock of the machine, plus an offset that a test sets."""

    def __init__(self) -> None:
        self.ahead_ns = 0

    def now_ns(self) -> int:
        return time.monotonic_ns() + self.ahead_ns


@contextmanager
def serving(
    plugin: EmulatorPlugin,
    where: str,
    faults: WireFaults,
    rig: StillRig,
    clock: Clock | None = None,
) -> Iterator[str]:
    """Serve a parrot; yield its place."""
    bench = SharedRig(rig, (clock or Clock()).now_ns)
    emulation = Emulation([EmulationRequest(plugin, where, faults)], bench, "7")
    (place,) = emulation.start()
    assert emulation.running()
    yield place
    emulation.stop()


@pytest.fixture(params=["serial", "tcp"])
def wire(request: pytest.FixtureRequest) -> str:
    """Return the kind of wire."""
    kind: str = request.param
    return kind


@pytest.fixture
def faults() -> WireFaults:
    """Return the faults of the wire."""
    return WireFaults()


@pytest.fixture
def rig() -> StillRig:
    """Return the rig."""
    return StillRig(2)


@pytest.fixture
def clock() -> Clock:
    """Return the clock of the faults."""
    return Clock()


@pytest.fixture
def line(
    wire: str, faults: WireFaults, rig: StillRig, clock: Clock, tmp_path: Path
) -> Iterator[Line]:
    """Yield an open line to a parrot."""
    plugin, where = (SERIAL, str(tmp_path / "port")) if wire == "serial" else (TCP, "")
    with serving(plugin, where, faults, rig, clock) as place:
        found: Line = SerialLine(place, 9600) if wire == "serial" else TcpLine(*address(place))
        found.open()
        yield found
        found.close()


def ask(line: Line, request: bytes = b"x", within_ns: int = LONG_NS) -> bytes:
    """Send bytes and return the reply."""
    line.send(request)
    return line.receive(within_ns)


def reopens(line: Line) -> bool:
    """Return whether a line can be opened."""
    try:
        line.open()
    except DeviceUnavailableError:
        return False
    return True


def gone(line: Line) -> bool:
    """Return whether a line is lost."""
    try:
        line.receive(1_000_000)
    except LineFault:
        return True
    return False


def test_device_answers_and_speaks_unasked(line: Line) -> None:
    """Its replies and its unsolicited messages arrive."""
    assert ask(line) == b"7:x"
    got = ask(line, b"later")
    while len(got) < len(b"7:xlaterunasked"):
        got += line.receive(LONG_NS)
    assert got == b"7:xlaterunasked"


def test_device_goes_on_when_its_client_comes_back(line: Line, wire: str) -> None:
    """The device stays the same; only over TCP does it notice a new client."""
    ask(line)
    for _ in range(3):
        line.close()
        eventually(lambda: reopens(line))
        heard = ask(line)

    assert heard == (b"7:xxxx" if wire == "serial" else b"7:x")


def test_connection_goes_and_comes_back(line: Line, faults: WireFaults, clock: Clock) -> None:
    """The reply is lost, and meanwhile no client can connect."""
    faults.set([parse("disconnect:2:3600")])
    assert ask(line) == b"7:x"

    def is_pulled() -> bool:
        with suppress(LineFault):
            line.send(b"x")  # in each attempt: unsent bytes are dropped
        return gone(line)

    eventually(is_pulled)
    assert not reopens(line)
    clock.ahead_ns += HOUR_NS
    eventually(lambda: reopens(line))
    assert ask(line).startswith(b"7:")


def test_unplugged_device_may_be_restarted(
    line: Line, faults: WireFaults, rig: StillRig, clock: Clock
) -> None:
    """It is connected again when both absences are over."""
    assert ask(line, b"drive") == b"7:drive"
    faults.set([parse("disconnect:now:3600")])
    eventually(lambda: gone(line))
    faults.set([parse("restart:now:3600")])
    eventually(lambda: rig.drive_v == [0.0, 0.0])
    clock.ahead_ns += HOUR_NS
    eventually(lambda: reopens(line))
    assert ask(line) == b"7:x"


def test_wire_is_no_bus(line: Line, faults: WireFaults) -> None:
    """Faults that need a bus have no effect on a wire."""
    faults.set([parse("bus-off"), parse("bus-off:now:3600"), parse("foreign")])

    assert [ask(line), ask(line)] == [b"7:x", b"7:xx"]


def test_another_device_comes_back(line: Line, faults: WireFaults) -> None:
    """It has another serial number."""
    faults.set([parse("wrong-identity:now:0.05")])
    eventually(lambda: gone(line))
    eventually(lambda: reopens(line))

    assert ask(line) == b"99000099:x"


def test_restarted_device_is_silent_and_then_new(
    line: Line, faults: WireFaults, rig: StillRig
) -> None:
    """The connection stays, the device is silent, and the amplifier goes to 0 V."""
    assert ask(line, b"drive") == b"7:drive"
    driven_v = list(rig.drive_v)
    faults.set([parse("restart:now:0.1")])
    eventually(lambda: rig.drive_v == [0.0, 0.0])
    heard = eventually(lambda: ask(line, b"x", 50_000_000))

    assert driven_v == [1.0, 1.0]
    assert heard.startswith(b"7:x")


def test_late_and_lost_replies(line: Line, faults: WireFaults) -> None:
    """The second reply is lost, and the unsolicited message after it is late."""
    faults.set([parse("lost:2"), parse("late:3:0.03")])
    first = ask(line, b"a")
    begin_ns = line.now_ns()
    second = ask(line, b"later")

    assert (first, second) == (b"7:a", b"unasked")
    assert line.now_ns() - begin_ns >= 30_000_000


def test_unread_bytes_are_dropped(line: Line) -> None:
    """A client that sends and never reads does not block the device."""
    for _ in range(100):
        with suppress(LineFault):  # the device may be slower than this test
            line.send(bytes(1000))
    eventually(lambda: line.receive(0) != b"")


@pytest.mark.parametrize(
    ("plugin", "where", "why"),
    [
        (SERIAL, "/nowhere/port", "cannot make a port at"),
        (SERIAL, "/dev/null", "exists already"),
        (TCP, "nowhere", "invalid address 'nowhere'"),
        (TCP, "localhost:99999", "invalid address"),
        (TCP, "192.0.2.1:1", "cannot listen at"),
    ],
)
def test_place_that_cannot_be(plugin: EmulatorPlugin, where: str, why: str, rig: StillRig) -> None:
    """The message states the place."""
    with (
        pytest.raises(DeviceUnavailableError, match=why),
        serving(plugin, where, WireFaults(), rig),
    ):
        pass


def test_link_that_leads_nowhere_is_replaced(tmp_path: Path, rig: StillRig) -> None:
    """A killed emulator leaves such a link."""
    path = tmp_path / "port"
    path.symlink_to("/dev/pts/none")
    with serving(SERIAL, str(path), WireFaults(), rig):
        assert path.exists()
    assert not path.is_symlink()


def test_link_that_nobody_serves_is_replaced(
    tmp_path: Path, rig: StillRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the user's own folder an unlocked link is replaced; a locked one is not."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    master, slave = os.openpty()
    left = os.ttyname(slave)
    path = make_own_folder() / "parrot.tty"
    path.symlink_to(left)
    with serving(SERIAL, "", WireFaults(), rig) as place:
        assert place == str(path)
        assert str(path.readlink()) != left
        with (
            pytest.raises(DeviceUnavailableError, match="is served by another process"),
            serving(SERIAL, "", WireFaults(), rig),
        ):
            pass
        assert path.is_symlink()
    with serving(SERIAL, "", WireFaults(), rig):
        assert path.exists()
    elsewhere = tmp_path / "port"
    elsewhere.symlink_to(left)
    with (
        pytest.raises(DeviceUnavailableError, match="exists already"),
        serving(SERIAL, str(elsewhere), WireFaults(), rig),
    ):
        pass
    os.close(master)
    os.close(slave)


def test_second_client_is_turned_away(rig: StillRig) -> None:
    """A TCP device serves one client; the first one stays connected."""
    with serving(TCP, "", WireFaults(), rig) as place:
        first, second = TcpLine(*address(place)), TcpLine(*address(place))
        first.open()
        assert ask(first) == b"7:x"
        second.open()
        eventually(lambda: gone(second))
        assert ask(first) == b"7:xx"
        first.close()
        second.close()


def test_one_that_fails_ends_all(rig: StillRig, tmp_path: Path) -> None:
    """The other devices on the rig are stopped too."""
    posts = [
        EmulationRequest(SERIAL, str(tmp_path / "port"), WireFaults()),
        EmulationRequest(TCP, "nowhere", WireFaults()),
    ]
    with pytest.raises(DeviceUnavailableError, match="nowhere"):
        Emulation(posts, SharedRig(rig, time.monotonic_ns)).start()
    assert not (tmp_path / "port").exists()


def test_plugin_without_either_way(rig: StillRig) -> None:
    """A plug-in without `create` and `serve` is refused."""
    with (
        pytest.raises(RegistryError, match="neither `create` nor `serve`"),
        serving(EmulatorPlugin("none", "none", "can"), "", WireFaults(), rig),
    ):
        pass


def test_plugin_may_serve_itself(rig: StillRig) -> None:
    """It is called with all its arguments."""

    def serve(
        bench: SharedRig,
        where: str,
        faults: WireFaults,
        serial: str,
        ready: Callable[[str], None],
        stopping: Callable[[], bool],
    ) -> None:
        ready(f"{where} {serial} {bench.n_axes} {faults.at_once()}")
        eventually(stopping)

    plugin = EmulatorPlugin("own", "own", "can", serve=serve)
    with serving(plugin, "here", WireFaults(), rig) as place:
        assert place == "here 7 2 []"


@pytest.mark.parametrize("name", emulators.names())
def test_every_installed_emulator_is_one(name: str) -> None:
    """It can be loaded, and has `create` or `serve`."""
    plugin = emulators.load(name)

    assert (plugin.create is None) != (plugin.serve is None)
    assert plugin.summary


def test_address_may_be_short() -> None:
    """A port alone is one of this machine; an empty text is any port."""
    assert (address("[::1]:502"), address("502"), address("")) == (
        ("::1", 502),
        ("127.0.0.1", 502),
        ("127.0.0.1", 0),
    )
    assert socket.inet_aton(address("")[0])


def test_error_is_a_device_error() -> None:
    """Commands derive the exit code from it."""
    with pytest.raises(DeviceError):
        address("x:y")
