"""Outputs that `can_dbc` must not change: unused ones, and all of them before a setpoint."""

from collections.abc import Sequence
from struct import pack, unpack_from
from typing import Any

import pytest
from pydantic import ValidationError

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.can_bus.dbc.dialogue import DbcDialogue
from piezod_drivers.can_bus.dbc.options import DbcOptions
from piezod_drivers.can_bus.dbc.used_signals import UsedSignals
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.fake_bus import FakeBus
from tests.drivers.serial_line.scripted_line import MS

COMMAND, STATUS, POLL = 0x100, 0x101, 0x102
BACK = ("b", "a")
"""Outputs that are read back."""


def _signal(start: int, **more: object) -> dict[str, object]:
    return {"start": start, "bits": 16, "scale": 0.01, **more}


def _options(request: str | None = "Poll", backs: Sequence[str] = BACK) -> dict[str, Any]:
    """Return options of a device whose two outputs are set by one message."""
    outputs: dict[str, Any] = {
        name: {"message": "Command", "signal": name.upper()} for name in ("a", "b")
    }
    for name in backs:
        outputs[name]["read_back"] = {"message": "Status", "signal": f"V{name.upper()}"}
    return {
        "bus": {"interface": "virtual", "channel": "x"},
        "timeout_ms": 20.0,
        "messages": {
            "Command": {
                "id": COMMAND,
                "signals": {
                    "A": _signal(0, range=(0.0, 150.0)),
                    "B": _signal(16, range=(0.0, 150.0)),
                    "Mode": {"start": 32, "bits": 8},
                },
            },
            "Status": {
                "id": STATUS,
                "signals": {"P": _signal(0), "VA": _signal(32), "VB": _signal(48)},
            },
            "Poll": {"id": POLL, "bytes": 0},
        },
        "inputs": {"p": {"message": "Status", "signal": "P"}},
        "outputs": outputs,
        "request": request,
    }


class Amplifier:
    """Implements `Node`: a command sets both outputs; it replies, or reports by itself.

    Args:
        reports: Whether it reports each change by itself.

    Attributes:
        codes: Present values of the outputs, in steps of 0.01 V.
        commands: Values that the outputs were set to.
    """

    def __init__(self, *, reports: bool) -> None:
        self._reports = reports
        self.codes: tuple[int, ...] = (10_000, 8_000)
        self._reported: tuple[int, ...] = ()
        self.commands: list[tuple[int, ...]] = []

    def receive(self, frame: Frame) -> list[Frame]:
        if frame.id == COMMAND:
            self.codes = unpack_from("<HH", frame.data)
            self.commands.append(self.codes)
            return []
        return [self._status()]

    def due(self) -> list[Frame]:
        reported, self._reported = self._reported, self.codes
        return [self._status()] if self._reports and reported != self.codes else []

    def foreign(self) -> Frame:
        raise NotImplementedError

    def _status(self) -> Frame:
        return Frame(STATUS, pack("<4H", 500, 0, *self.codes))


def _device(wiring: Wiring, options: dict[str, Any]) -> tuple[Any, Amplifier]:
    """Return a device that is not open, and the amplifier on its bus."""
    amplifier = Amplifier(reports=options["request"] is None)
    bus = FakeBus(amplifier)
    bus.delay_ns = 0
    kind = ExchangingBusDevice if all(wiring) else BusDevice
    return kind("it", DbcDialogue(DbcOptions.model_validate(options), wiring, bus)), amplifier


@pytest.mark.parametrize("request_", ["Command", "Twin"])
def test_request_that_drives_is_refused(request_: str) -> None:
    """A request that sets outputs is refused: the first one would set them to 0."""
    options = _options(request_)
    options["messages"]["Twin"] = {"id": COMMAND, "bytes": 8}
    with pytest.raises(ValidationError, match=f"{request_} sets output a: .* give a message that"):
        DbcOptions.model_validate(options)


@pytest.mark.parametrize("request_", ["Poll", None])
def test_unused_output_is_held(request_: str | None) -> None:
    """An unused output in a used message is sent with the value read back at activation."""
    device, amplifier = _device(Wiring(("p",), ("a",)), _options(request_))
    device.open()
    amplifier.codes = (10_000, 7_000)
    device.activate(MS)
    assert device.read_back(2 * MS) == [100.0]
    assert device.write([100.5], 3 * MS)
    assert device.exchange([101.0], 4 * MS)[0]

    assert amplifier.commands == [(10_050, 7_000), (10_100, 7_000)]


def test_output_is_held_where_it_is_after_the_device_was_away() -> None:
    """An unused output is read back again at each activation."""
    device, amplifier = _device(Wiring((), ("b",)), _options())
    device.open()
    device.activate(MS)
    device.close()
    amplifier.codes = (2_000, 8_000)
    device.open()
    device.activate(2 * MS)
    assert device.write([81.0], 3 * MS)

    assert amplifier.commands == [(2_000, 8_100)]


def test_output_that_cannot_be_read_back_has_to_be_used() -> None:
    """An unused output without read-back is refused at opening, with the remedy."""
    options = _options(backs=("a",))
    device, amplifier = _device(Wiring(("p",), ("a",)), options)
    with pytest.raises(DeviceError, match=r"Command also sets output b, .* give it one, or"):
        device.open()

    for wiring in (Wiring(("p",), ("a", "b")), Wiring(("p",), ("b",)), Wiring(("p",), ())):
        device, amplifier = _device(wiring, options)
        device.open()
        device.activate(MS)
        assert not amplifier.commands


def test_bus_is_listened_to_where_nothing_is_read_back() -> None:
    """Without any expected reply, bus off and refused frames are still reported."""
    bus = FakeBus(Amplifier(reports=False))
    dialogue = DbcDialogue(
        DbcOptions.model_validate(_options(backs=())), Wiring((), ("a", "b")), bus
    )
    device: Any = BusDevice("it", dialogue)
    device.open()
    device.activate(MS)
    assert device.write([1.0, 2.0], 2 * MS)

    def left(within_ns: int) -> Frame | None:  # noqa: ARG001 - the interface's
        raise LineFault(DeviceFlag.BUS_OFF, "the test demands it")

    bus.receive = left  # type: ignore[method-assign] # a bus that was left
    assert not device.write([3.0, 4.0], 3 * MS)
    assert DeviceFlag.BUS_OFF in frozenset().union(*device.status(3 * MS))
    assert [frame.id for frame in bus.sent] == [COMMAND]


def test_output_that_is_beyond_its_range_is_not_taken_over() -> None:
    """An unused output that reads back beyond its range prevents activation; nothing is set."""
    device, amplifier = _device(Wiring((), ("a",)), _options())
    device.open()
    amplifier.codes = (0, 15_200)
    with pytest.raises(DeviceError, match=r"output b, .* reads back 152, allowed range 0 to 150"):
        device.activate(MS)
    amplifier.codes = (0, 15_001)
    device.activate(MS)
    assert device.write([1.0], 2 * MS)

    assert amplifier.commands == [(100, 15_000)]


def test_output_that_does_not_tell_where_it_is_is_not_taken_over() -> None:
    """A device that has fallen silent cannot be activated."""
    device, amplifier = _device(Wiring((), ("a",)), _options())
    device.open()
    amplifier.receive = lambda frame: []  # type: ignore[method-assign] # noqa: ARG005 # a silent one
    with pytest.raises(DeviceUnavailableError, match="cannot be activated"):
        device.activate(MS)
    assert not device.write([1.0], 2 * MS)


@pytest.mark.parametrize("request_", ["Poll", None])
def test_device_with_only_inputs_in_use_gets_no_command(request_: str | None) -> None:
    """With inputs only, requests are sent and no command."""
    device, amplifier = _device(Wiring(("p",), ()), _options(request_))
    device.open()
    device.activate(MS)
    assert device.read(2 * MS)[0].position_um == 5.0
    device.close()

    assert not amplifier.commands


def test_digital_output_needs_no_read_back() -> None:
    """A bit beside a voltage that is read back is a line of the loop, whose value is unknown."""
    options = _options()
    options["messages"]["Command"]["signals"]["Shutter"] = {"start": 40, "bits": 1}
    options["outputs"]["shutter"] = {"message": "Command", "signal": "Shutter"}
    used = DbcOptions.model_validate(options)
    both = UsedSignals(used, Wiring(("p",), ("a", "shutter")))
    alone = UsedSignals(used, Wiring(("p",), ("b", "a", "shutter")))

    assert both.reads_back
    assert [place is None for place in both.read_backs] == [False, True]
    assert alone.ranges[2] == (0.0, 1.0)
    options["outputs"]["a"].pop("read_back")
    bare = DbcOptions.model_validate(options)
    assert not UsedSignals(bare, Wiring(("p",), ("a", "b", "shutter"))).reads_back
