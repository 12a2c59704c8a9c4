"""The host of an emulated node: each fault, and each kind of end."""

import os
from pathlib import Path

import pytest

from piezod.devices.emulation.faults import WireFaults, parse
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.cia401.emulator import Cia401Node
from piezod_drivers.can_bus.emulation.ends import AdapterEnd, LibraryEnd, end_at
from piezod_drivers.can_bus.emulation.host import NodeHost
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.slcan_codec import encode
from tests.drivers.can_bus.ports import free_port
from tests.drivers.can_bus.profiles import GROUP
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS

ASK = Frame(0x605, bytes((0x40, 0x00, 0x10, 0, 0, 0, 0, 0)))
ANSWER = Frame(0x585, bytes((0x43, 0x00, 0x10, 0, 0x91, 0x01, 0x0C, 0)))


class _End:
    """Implements `BusEnd`; records everything."""

    def __init__(self) -> None:
        self.coming: list[Frame] = []
        self.sent: list[Frame] = []
        self.calls: list[object] = []

    def place(self) -> str:
        return "here"

    def appear(self) -> None:
        self.calls.append("there")

    def vanish(self) -> None:
        self.calls.append("gone")

    def receive(self, _within_ns: int) -> list[Frame]:
        coming, self.coming = self.coming, []
        return coming

    def send(self, frame: Frame) -> None:
        self.sent.append(frame)

    def noise(self, data: bytes) -> None:
        self.calls.append(data)

    def leave(self, away: bool) -> None:
        self.calls.append(away)


class _Hosted:
    def __init__(self) -> None:
        on_bench, self.rig, self.time = bench(1)
        self.end, self.faults = _End(), WireFaults()
        self.serials: list[str] = []

        def make(serial: str) -> Cia401Node:
            self.serials.append(serial)
            return Cia401Node(on_bench)

        self.host = NodeHost(self.end, make, on_bench, self.faults, "7")
        self.host.advance(0)  # boot-up
        self.end.sent.clear()

    def asked(self, *faults: str) -> list[Frame]:
        """Return the frames that are sent for a request while a fault is active."""
        self.faults.set(map(parse, faults))
        self.end.sent.clear()
        self.end.coming = [ASK]
        self.host.advance(0)
        return self.end.sent


def test_each_fault_hits_frames() -> None:
    """Frames are lost, doubled, cut, garbled, delayed, foreign, or follow noise."""
    hosted = _Hosted()
    foreign = Frame(0x305, bytes(8))

    assert hosted.asked() == [ANSWER]
    assert hosted.asked("lost") == []
    assert hosted.asked("duplicated") == [ANSWER, ANSWER]
    assert hosted.asked("partial:1:3") == [ANSWER._replace(data=ANSWER.data[:3])]
    assert hosted.asked("garbled:1:0") == [
        ANSWER._replace(data=bytes((ANSWER.data[0] ^ 1,)) + ANSWER.data[1:])
    ]
    assert hosted.asked("foreign") == [foreign, ANSWER]
    assert hosted.asked("noise:1:4") == [ANSWER]
    assert isinstance(hosted.end.calls[-1], bytes)
    assert hosted.asked("late:1:0.05") == []
    hosted.time.t_ns += 51 * MS
    hosted.host.advance(0)
    assert hosted.end.sent == [ANSWER]


@pytest.mark.parametrize(
    ("fault", "calls", "serials"),
    [
        ("disconnect", ["gone", "there"], ["7"]),
        ("wrong-identity", ["gone", "there"], ["7", "99000099"]),
        ("restart", [], ["7", "7"]),
        ("bus-off", [True, False], ["7"]),
    ],
)
def test_each_fault_hits_the_node(fault: str, calls: list[object], serials: list[str]) -> None:
    """The node is absent for the given time and then back; a restart sets it to 0 V."""
    hosted = _Hosted()
    hosted.rig.drive_v = [50.0]
    assert hosted.asked(f"{fault}:now:0.01") == [] or fault == "bus-off"
    hosted.time.t_ns += 11 * MS
    hosted.host.advance(0)

    assert hosted.end.calls == calls
    assert hosted.serials == serials
    assert hosted.rig.drive_v == ([0.0] if fault == "restart" else [50.0])
    assert ANSWER in hosted.asked()


@pytest.mark.parametrize("second", ["disconnect", "wrong-identity", "restart", "bus-off"])
@pytest.mark.parametrize("seconds", [0.01, 0.03])
def test_node_may_be_away_for_two_reasons(second: str, seconds: float) -> None:
    """With two reasons to be absent, the node is back when both are over."""
    for first in ("disconnect", "bus-off"):
        hosted = _Hosted()
        hosted.asked(f"{first}:now:0.02")
        hosted.asked(f"{second}:now:{seconds}")
        hosted.time.t_ns += 21 * MS
        hosted.host.advance(0)
        hosted.time.t_ns += 10 * MS
        hosted.host.advance(0)

        assert hosted.end.calls.count("there") == ("gone" in hosted.end.calls)
        assert hosted.end.calls[-1] in {"there", False}
        assert ANSWER in hosted.asked()


def test_noise_comes_after_what_is_late() -> None:
    """Noise comes directly before its own frame, behind delayed frames."""
    hosted = _Hosted()
    assert hosted.asked("late:1:0.05") == []
    assert hosted.asked("noise:1:4") == []
    assert hosted.end.calls == []
    hosted.time.t_ns += 51 * MS
    hosted.host.advance(0)

    assert hosted.end.sent == [ANSWER, ANSWER]
    assert [type(each) for each in hosted.end.calls] == [bytes]


def test_serving_begins_and_ends() -> None:
    """Serving reports the node's place when it starts and removes the end when it stops."""
    hosted = _Hosted()
    places: list[str] = []
    stops = iter([False, True])
    hosted.host.serve(places.append, lambda: next(stops))

    assert places == ["here"]
    assert hosted.end.calls == ["there", "gone"]


def test_adapter_end_is_a_port(tmp_path: Path) -> None:
    """At its port an adapter accepts commands and frames, and passes frames on when open."""
    end = end_at(str(tmp_path / "can.tty"), "any")
    assert isinstance(end, AdapterEnd)
    end.appear()
    port = os.open(end.place(), os.O_RDWR | os.O_NOCTTY)
    os.write(port, b"O\r" + encode(ASK))
    assert end.receive(1000 * MS) == [ASK]
    end.send(ANSWER)
    end.noise(b"x")
    expected = b"\rz\r" + encode(ANSWER) + b"x"
    got = b""
    while len(got) < len(expected):
        got += os.read(port, 100)
    assert got == expected
    end.leave(True)
    os.write(port, encode(ASK))
    assert end.receive(1000 * MS) == []
    os.close(port)
    end.vanish()


def test_group_end_is_a_member() -> None:
    """In its group an end sends and receives frames unless it is off the bus."""
    where = f"udp:{GROUP}:{free_port()}"
    one, other = end_at(where, "any"), end_at(where, "any")
    assert isinstance(one, LibraryEnd)
    assert one.place() == where
    one.appear()
    other.appear()
    one.noise(b"x")
    one.send(ASK)
    assert other.receive(1000 * MS) == [ASK]
    one.leave(True)
    one.send(ASK)
    other.send(ANSWER)
    assert one.receive(1000 * MS) == []
    assert other.receive(0) == []
    one.vanish()
    other.vanish()
    assert other.receive(0) == []
    other.send(ASK)  # the frame is lost, and the emulator goes on


def test_unplugged_adapter_stays_off_the_bus(tmp_path: Path) -> None:
    """An adapter that is off the bus is still off when plugged in again."""
    end = end_at(str(tmp_path / "can.tty"), "any")
    end.appear()
    end.leave(True)
    end.vanish()
    end.appear()
    port = os.open(end.place(), os.O_RDWR | os.O_NOCTTY)
    os.write(port, b"O\r" + encode(ASK))
    assert end.receive(1000 * MS) == []
    os.close(port)
    end.vanish()


def test_group_that_is_none_is_refused() -> None:
    """An invalid group is refused with the expected format."""
    with pytest.raises(DeviceUnavailableError, match="expected GROUP:PORT"):
        end_at("udp:239.1.1.1:many", "any")


def test_interface_that_is_not_named_is_refused() -> None:
    """`socketcan:` alone is refused, with the expected form."""
    with pytest.raises(DeviceUnavailableError, match="expected socketcan:can1"):
        end_at("socketcan:", "any")


def test_interface_of_the_kernel_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """`socketcan:CHANNEL` opens that interface, for all frames."""
    opened: list[tuple[str, str, object]] = []

    def bus(channel: str, interface: str, can_filters: object, **_settings: object) -> None:
        opened.append((interface, channel, can_filters))

    monkeypatch.setattr("can.Bus", bus)
    end = end_at("socketcan:can1", "any")
    end.appear()

    assert end.place() == "socketcan:can1"
    assert opened == [("socketcan", "can1", [])]
