"""SDO replies as loose as CiA 301 allows, and those that it does not allow."""

from collections.abc import Callable, Iterator

import pytest

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.can_bus.cia401.emulator import NODE
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.cia401_stand import Stand, read, without
from tests.drivers.can_bus.profiles import CODES

Change = Callable[[Frame], list[Frame]]
CHANNEL = {"number": 1, **CODES}
REPLY = 0x580 + NODE
CHANNELS = frozenset({b"\x01\x64", b"\x11\x64"})
"""Index of the inputs and of the outputs, as in a frame."""


def _is_expedited(frame: Frame) -> bool:
    return frame.id == REPLY and frame.data[0] & 0xE2 == 0x42


def sizeless(frame: Frame) -> list[Frame]:
    """Leave out the size of an expedited reply; the bytes beyond it mean nothing."""
    if not _is_expedited(frame):
        return [frame]
    n_bytes = 4 - (frame.data[0] >> 2 & 3)
    junk = b"\xaa\xbb\xcc\xdd"[n_bytes:]
    return [frame._replace(data=b"\x42" + frame.data[1 : 4 + n_bytes] + junk)]


def twice(frame: Frame) -> list[Frame]:
    """Send each SDO reply twice."""
    return [frame, frame] if frame.id == REPLY else [frame]


class Segmenting:
    """A node that sends every object in segments.

    Args:
        stand: Where it is.
        sized: Whether it tells the number of bytes, at the beginning and in the last segment.
    """

    def __init__(self, stand: Stand, *, sized: bool) -> None:
        self._sized, self._rest = sized, b""
        stand.bus.on_send = self._hear
        self._asked = b""

    def _hear(self, frame: Frame) -> None:
        self._asked = frame.data if frame.id == 0x600 + NODE else b""

    def __call__(self, frame: Frame) -> list[Frame]:
        if _is_expedited(frame):
            n_bytes = 4 - (frame.data[0] >> 2 & 3)
            self._rest = frame.data[4 : 4 + n_bytes]
            size = n_bytes.to_bytes(4, "little") if self._sized else bytes(4)
            return [frame._replace(data=bytes((0x40 | self._sized,)) + frame.data[1:4] + size)]
        if frame.id == REPLY and self._asked[:1] == b"\x60" and self._rest:
            data, self._rest = self._rest, b""
            unused = 7 - len(data) if self._sized or len(data) != 2 else 0
            return [frame._replace(data=bytes((unused << 1 | 1,)) + data.ljust(7, b"\0"))]
        return [frame]


@pytest.fixture(params=["pdo", "sdo"])
def stand(request: pytest.FixtureRequest) -> Iterator[Stand]:
    """Yield a node with a watchdog, whose outputs are read back in one of both ways."""
    outputs = {"a1": {**CHANNEL, "safe_code": 0}}
    yield Stand((30.0, 60.0), inputs={"a1": CHANNEL}, outputs=outputs, read_back=request.param)


def _drives(stand: Stand) -> None:
    device = stand.active()
    assert device.capabilities().watchdog
    assert device.exchange([1.0], stand.time.t_ns)[0]
    assert stand.rig.drive_v[0] == pytest.approx(15.0, abs=0.1)
    assert device.read_back(stand.time.t_ns + 1) == pytest.approx([1.0], abs=0.01)
    assert not any(device.status(stand.time.t_ns))


def test_sizes_may_be_left_out(stand: Stand) -> None:
    """The size of an object follows from its type if an expedited reply leaves it out."""
    stand.bus.change = sizeless
    _drives(stand)


@pytest.mark.parametrize("sized", [True, False])
def test_objects_may_come_in_segments(stand: Stand, sized: bool) -> None:
    """Any object may be sent in segments, also one of two bytes, in the loop, too."""
    stand.bus.change = Segmenting(stand, sized=sized)
    _drives(stand)


def test_repeated_replies_answer_nothing_else(stand: Stand) -> None:
    """A reply that comes twice is not taken for the reply to the next request."""
    stand.bus.change = twice
    device = stand.active()
    assert device.exchange([1.0], stand.time.t_ns)[0]
    assert device.read_back(stand.time.t_ns + 1) == pytest.approx([1.0], abs=0.01)


def test_sensor_that_is_only_read_may_leave_sizes_out() -> None:
    """The same holds for inputs that are read by SDO."""
    stand = Stand((30.0, 60.0))
    stand.bus.change = sizeless
    device = stand.active(Wiring(("a1",), ()))
    assert read(device, stand) == pytest.approx([1.2], abs=0.01)


def _of_channels(n_bytes: int) -> Change:
    """Say that channels have another size."""

    def change(frame: Frame) -> list[Frame]:
        if not _is_expedited(frame) or frame.data[1:3] not in CHANNELS:
            return [frame]
        return [frame._replace(data=bytes((0x43 | (4 - n_bytes) << 2,)) + frame.data[1:])]

    return change


@pytest.mark.parametrize("n_bytes", [1, 4])
def test_channel_of_another_size_is_refused_when_opening(n_bytes: int) -> None:
    """What the loop cannot read is refused before it runs, with object and both sizes."""
    for wiring in (Wiring(("a1",), ()), Wiring((), ("a1",))):
        stand = Stand(read_back="sdo")
        stand.bus.change = _of_channels(n_bytes)
        with pytest.raises(DeviceError, match=rf"0x64[01]1:1 has {n_bytes} bytes, expected 2"):
            stand.make(wiring).open()


def test_channel_that_cannot_be_read_is_refused_when_opening() -> None:
    """A node without the object is refused with the object and the abort code."""
    stand = Stand(read_back="sdo")
    without(stand, {0x6411})
    with pytest.raises(DeviceError, match=r"0x6411:1 cannot be read.*0x06020000"):
        stand.make(Wiring((), ("a1",))).open()


@pytest.mark.parametrize("code", [0x0601_0000, 0x0602_0000, 0x0609_0011, 0x0800_0000])
def test_abort_codes_of_optional_objects(code: int) -> None:
    """Parts of the identity are optional, whichever way the node says that it lacks them."""
    stand = Stand()

    def change(frame: Frame) -> list[Frame]:
        if frame.id == REPLY and frame.data[1:4] in {b"\x18\x10\x03", b"\x18\x10\x04"}:
            return [frame._replace(data=b"\x80" + frame.data[1:4] + code.to_bytes(4, "little"))]
        return [frame]

    stand.bus.change = change
    assert stand.device.open().serial == "0"


def test_reply_that_fits_nothing_is_shown() -> None:
    """A node that replies in a way that CiA 301 does not know is refused with these bytes."""
    stand = Stand()
    stand.bus.change = lambda frame: [frame._replace(data=b"\x4b\x00\x20" + frame.data[3:])]
    with pytest.raises(DeviceUnavailableError, match="does not fit: 4b 00 20"):
        stand.device.open()


def test_longer_process_data_is_read() -> None:
    """A PDO may be longer than its mapping."""
    stand = Stand((30.0, 60.0), outputs={})
    stand.bus.change = lambda frame: [
        frame._replace(data=frame.data.ljust(8, b"\x55")) if frame.id == 0x280 + NODE else frame
    ]
    device = stand.active()
    assert read(device, stand) == pytest.approx([1.2, 2.4], abs=0.01)
