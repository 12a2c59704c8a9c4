"""The driver `can_dbc` with the emulated device, in virtual time."""

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from pydantic import ValidationError

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.dbc.dialogue import DbcDialogue
from piezod_drivers.can_bus.dbc.driver import PLUGIN, create
from piezod_drivers.can_bus.dbc.emulator import COMMAND, POLL, STATUS, DemoNode
from piezod_drivers.can_bus.dbc.options import DbcOptions, channels
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.fake_bus import FakeBus
from tests.drivers.can_bus.profiles import polled, reported
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS

BOTH = Wiring(("position",), ("drive",))


class Stand:
    """The emulated device, the fake bus it is on, and the driver.

    Args:
        make: Returns the options.
    """

    def __init__(
        self, make: Callable[[str, float], Mapping[str, object]] = polled, wiring: Wiring = BOTH
    ) -> None:
        on_bench, self.rig, self.time = bench(1)
        self.bus = FakeBus(DemoNode(on_bench), self.time)
        self.options = DbcOptions.model_validate(dict(make("/dev/null", 20.0)))
        dialogue = DbcDialogue(self.options, wiring, self.bus)
        kind = ExchangingBusDevice if all(wiring) else BusDevice
        self.device: Any = kind("the device", dialogue)
        self.device.open()
        self.device.activate(self.time.t_ns)

    def flags(self) -> frozenset[DeviceFlag]:
        """Return the flags of all channels."""
        return frozenset().union(*self.device.status(self.time.t_ns))


def test_device_that_answers_is_driven_and_read() -> None:
    """One exchange sends command and request and uses the values of the reply."""
    stand = Stand()
    stand.bus.sent.clear()
    now_ns = stand.time.t_ns
    taken, (sample,) = stand.device.exchange([50.0], now_ns)

    assert taken
    assert sample.position_um == pytest.approx(10.0, abs=0.001)
    assert stand.device.read_back(now_ns) == [50.0]
    assert [frame.id for frame in stand.bus.sent] == [COMMAND.id, POLL.id]
    assert stand.flags() == frozenset()


def test_opening_and_reading_drive_nothing() -> None:
    """Before the first setpoint no command is sent, so the output keeps its value."""
    stand = Stand()
    stand.device.read(stand.time.t_ns)

    assert COMMAND.id not in {frame.id for frame in stand.bus.sent}


def test_device_that_reports_is_driven_and_read() -> None:
    """The latest report counts, with the instant at which it came."""
    stand = Stand(reported)
    assert stand.device.write([50.0], stand.time.t_ns)
    stand.time.t_ns += 6 * MS
    stand.bus.receive(0)
    now_ns = stand.time.t_ns + MS
    stand.time.t_ns = now_ns
    (sample,) = stand.device.read(now_ns)

    assert sample.position_um == pytest.approx(10.0, abs=0.001)
    assert sample.t_ns <= now_ns
    assert stand.device.read_back(now_ns) == [50.0]


def test_old_report_does_not_count() -> None:
    """When reports stop, samples become invalid as soon as the last one is too old."""
    stand = Stand(reported)
    stand.bus.node = None
    assert stand.device.read(stand.time.t_ns)[0].valid
    stand.time.t_ns += 30 * MS

    assert not stand.device.read(stand.time.t_ns)[0].valid
    assert DeviceFlag.LATE_REPLY in stand.flags()


def test_answer_to_an_earlier_request_does_not_count() -> None:
    """The echo of the counter distinguishes a late reply from the reply to this request."""
    stand = Stand()
    stand.bus.delay_ns = 30 * MS
    assert not stand.device.read(stand.time.t_ns)[0].valid
    stand.bus.delay_ns = 15 * MS  # the late reply comes first
    stand.rig.drive_v = [25.0]

    (sample,) = stand.device.read(stand.time.t_ns)
    assert sample.position_um == pytest.approx(5.0, abs=0.001)
    assert DeviceFlag.OUT_OF_ORDER in stand.flags()


def test_device_that_is_silent_cannot_be_opened() -> None:
    """If nothing comes, opening fails and names possible causes."""
    for make in (polled, reported):
        stand = Stand(make)
        stand.device.close()
        stand.bus.node = None
        with pytest.raises(DeviceUnavailableError, match="terminations"):
            stand.device.open()


def test_channel_of_either_kind_alone() -> None:
    """A device with inputs only sends no command; one with outputs only needs the reply."""
    reads = Stand(wiring=Wiring(("position",), ()))
    assert reads.device.read(reads.time.t_ns)[0].valid
    drives = Stand(wiring=Wiring((), ("drive",)))
    assert drives.device.write([50.0], drives.time.t_ns)
    assert drives.rig.drive_v == [50.0]


FLAGS = (
    ("A4", "overload"),
    ("A8", "local mode"),
    ("A9", "watchdog tripped"),
    ("A11", "short or open"),
    ("A13", "over-temperature"),
    ("S7", "saturated"),
    ("S8", "low light"),
)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.sees("can_dbc", each), id=name) for each, name in FLAGS],
)
def test_signal_that_stands_for_a_flag_is_reported(name: str) -> None:
    """A signal configured as a flag is reported as long as it is not 0."""

    def options(where: str, timeout_ms: float) -> Mapping[str, object]:
        return {
            **polled(where, timeout_ms),
            "flags": {name: {"message": "Status", "signal": "Saturated"}},
        }

    stand = Stand(options)
    stand.device.read(stand.time.t_ns)
    assert stand.flags() == frozenset()

    stand.rig.valid = False
    stand.device.read(stand.time.t_ns)
    assert stand.flags() == {DeviceFlag(name)}


@pytest.mark.sees("can_dbc", "B12")
def test_foreign_command_is_reported() -> None:
    """A command from another sender is reported as foreign."""
    stand = Stand()
    stand.bus.comes(Frame(COMMAND.id, bytes(8)))
    stand.device.read(stand.time.t_ns)

    assert DeviceFlag.FOREIGN_FRAME in stand.flags()


def _inline() -> dict[str, Any]:
    return {
        "bus": {"interface": "virtual", "channel": "x"},
        "messages": {
            "Set": {"id": 0x10, "signals": {"U": {"start": 0, "bits": 16, "scale": 0.01}}},
            "Got": {
                "id": 0x1ABCDEF0,
                "extended": True,
                "bytes": 4,
                "signals": {"Z": {"start": 7, "bits": 16, "big_endian": True, "unit": "µm"}},
            },
        },
        "inputs": {"z": {"message": "Got", "signal": "Z"}},
        "outputs": {"u": {"message": "Set", "signal": "U"}},
    }


def test_frames_may_be_described_in_the_configuration() -> None:
    """Without a DBC file the configuration describes messages and signals."""
    options = DbcOptions.model_validate(_inline())
    bus = FakeBus()
    device: Any = ExchangingBusDevice("it", DbcDialogue(options, Wiring(("z",), ("u",)), bus))
    got = Frame(0x1ABCDEF0, b"\x00\x05\0\0", extended=True)
    bus.when_opened = [got]
    device.open()
    device.activate(0)
    taken, (sample,) = device.exchange([1.5], 0)

    assert taken
    assert sample.position_um == 5.0
    assert bus.sent == [Frame(0x10, b"\x96" + bytes(7))]
    assert channels(options)[:] == ({"z": "µm"}, {"u": "V"})
    assert not device.capabilities().read_back


def _wrong(path: tuple[str, ...], value: object, make: Callable[[], dict[str, Any]]) -> str:
    options: Any = make()
    inner = options
    for key in path[:-1]:
        inner = inner.setdefault(key, {})
    if value is None:
        inner.pop(path[-1])
    else:
        inner[path[-1]] = value
    with pytest.raises(ValidationError) as failure:
        DbcOptions.model_validate(options)
    return str(failure.value)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("inputs", "z", "signal"), "Y", "there is no signal Y"),
        (("inputs", "z", "message"), "Gott", "did you mean 'Got'"),
        (("request",), "Ask", "there is no message Ask"),
        (("messages",), {}, "give either dbc, a file, or messages"),
        (("messages", "Set", "id"), 0x800, "does not fit into 11 bits"),
        (("messages", "Set", "bytes"), 1, "does not fit into the 1 bytes of Set"),
        (("messages", "Set", "signals", "U", "scale"), 0.0, "must not be 0"),
        (("checksums", "Set"), {"signal": "U"}, "must be exactly one byte of the frame"),
        (("counters", "Set"), "N", "there is no signal N"),
    ],
)
def test_mistakes_are_reported_with_their_place(
    path: tuple[str, ...], value: object, message: str
) -> None:
    """Options that contradict each other are refused, with the place and the remedy."""
    assert message in _wrong(path, value, _inline)


def test_echo_without_a_counter_is_a_mistake() -> None:
    """An echo without a counter of the request is refused."""
    assert "an echo repeats a counter" in _wrong(
        ("counters", "Poll"), None, lambda: polled("/dev/null")
    )


def test_plug_in_makes_the_device_without_opening_anything() -> None:
    """The plug-in makes an exchanging device for channels of both kinds."""
    options = DbcOptions.model_validate(polled("/dev/null"))

    assert isinstance(create(options, BOTH, 0), ExchangingBusDevice)
    assert not isinstance(create(options, Wiring(("position",), ()), 0), ExchangingBusDevice)
    assert not PLUGIN.confirmed_on_hardware
    assert STATUS.id == 0x180
