from struct import unpack_from
from typing import Any

import pytest

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.options import ModbusOptions
from tests.drivers.modbus.emulated import TIMEOUT_S, emulated
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

WATCHED = {"watchdog": {"timeout_s": 2.0, "safe": 0.0}}
BOXES = ({"unit": 1, "profile": "icpdas-m7017"}, {"unit": 2, "profile": "icpdas-m7024"})
WAVESHARE = ({"unit": 1, "profile": "waveshare-ai8b"}, {"unit": 2, "profile": "waveshare-ao8b"})
ONE = Wiring(("AI0",), ("AO0",))
# The second output of the emulated coupler serves as the status register of a custom device.
TRIPPED = {"role": "status", "address": 0x201, "flag": "watchdog tripped", "mask": 0x4000}
DRIVE = {"role": "output", "channel": "AO0", "address": 0, "range": (0.0, 30_000.0)}
CASES: list[Any] = [
    pytest.param(emulator.ADAM_6024, {"profile": "adam-6024", "host": "h"}, ONE, id="adam-6024"),
    pytest.param(emulator.WAGO_750, {"profile": "wago-750", "host": "h"}, ONE, id="wago-750"),
    pytest.param(emulator.ICPDAS, {"units": BOXES, "port": "p"}, ONE, id="icpdas"),
    pytest.param(
        emulator.WAVESHARE,
        {"units": WAVESHARE, "port": "p"},
        Wiring(("AI1",), ("AO1",)),
        id="waveshare",
    ),
]


def opened(
    plugin: EmulatorPlugin, options: dict[str, object], wiring: Wiring = ONE
) -> tuple[BusDevice, EmulatedLine, Any]:
    """Return an active device, its line and the rig at the other end."""
    device, line, rig = emulated(plugin, ModbusOptions.model_validate(options), wiring)
    device.open()
    device.activate(line.now_ns())
    return device, line, rig


def outputs_only() -> tuple[BusDevice, EmulatedLine, Any]:
    """Return an active device with an output, a status and no input, its line and the rig."""
    options: dict[str, object] = {"registers": (DRIVE, TRIPPED), "host": "h"}
    return opened(emulator.WAGO_750, options, Wiring((), ("AO0",)))


def set_by_somebody_else(line: EmulatedLine, address: int, word: int) -> None:
    """Write a register without the driver."""
    frame = bytes.fromhex("ffff000000060106")
    line.send(frame + address.to_bytes(2, "big") + word.to_bytes(2, "big"))
    line.receive(MS)


@pytest.mark.parametrize(("plugin", "options", "wiring"), CASES)
def test_an_input_follows_its_output(
    plugin: EmulatorPlugin, options: dict[str, object], wiring: Wiring
) -> None:
    """4 V at the output are 60 V at the actuator, 12 µm and 2.4 V at the input."""
    device, line, rig = opened(plugin, options, wiring)
    for value in (4.0, 0.0, 8.0):
        assert device.write([value], line.now_ns())
        assert rig.drive_v == [pytest.approx(15 * value, abs=0.05)]
        assert list(device.read_back(line.now_ns())) == pytest.approx([value], abs=0.005)
        (sample,) = device.read(line.now_ns())
        assert sample.valid
        assert sample.position_um == pytest.approx(15 * value * 0.2 / 5, abs=0.005)
        assert device.status(line.now_ns()) == [frozenset()] * 2
    device.close()
    assert rig.drive_v == [pytest.approx(120, abs=0.05)]


@pytest.mark.parametrize(("plugin", "options", "wiring"), CASES)
def test_opening_moves_nothing(
    plugin: EmulatorPlugin, options: dict[str, object], wiring: Wiring
) -> None:
    """Opening, activating, reading and closing a device send no write."""
    device, line, _ = opened(plugin, options, wiring)
    device.read(line.now_ns())
    device.read_back(line.now_ns())
    device.close()
    at = 7 if "host" in options else 1
    assert {frame[at] for frame in line.sent} <= {1, 3, 4}


def test_a_coupler_with_function_23_needs_one_request_for_a_cycle() -> None:
    """One request of function 23 sets the outputs and reads the inputs."""
    device, line, rig = opened(emulator.WAGO_750, {"profile": "wago-750", "host": "h"})
    assert isinstance(device, ExchangingBusDevice)
    device.exchange([1.0], line.now_ns())
    line.sent.clear()
    taken, (sample,) = device.exchange([4.0], line.now_ns())
    assert taken
    assert sample.position_um == pytest.approx(2.4, abs=0.005)
    assert rig.drive_v == [pytest.approx(60, abs=0.05)]
    assert [frame[7] for frame in line.sent] == [23]


def test_driver_that_sets_and_reads_in_time_is_not_silent() -> None:
    """The status is read ten times a second, not before every request."""
    device, line, _ = opened(emulator.WAGO_750, {"profile": "wago-750", "host": "h"})
    assert isinstance(device, ExchangingBusDevice)
    line.sent.clear()
    for _ in range(100):
        assert device.exchange([4.0], line.now_ns())[0]
        line.time.t_ns += 10 * MS
    assert [frame[7] for frame in line.sent].count(3) == 10


@pytest.mark.sees("modbus", "A9")
def test_the_watchdog_of_a_coupler_is_armed_and_seen_to_trip() -> None:
    """After a silence the outputs are at 0 V, and nothing is set until the device is reopened."""
    options: dict[str, object] = {"profile": "wago-750", "host": "h", **WATCHED}
    device, line, rig = opened(emulator.WAGO_750, options)
    assert device.capabilities().watchdog
    assert not isinstance(device, ExchangingBusDevice)
    assert device.write([4.0], line.now_ns())
    line.time.t_ns += 1900 * MS
    assert device.read(line.now_ns())[0].valid
    assert rig.drive_v != [0.0]
    line.time.t_ns += 2100 * MS
    line.receive(0)
    assert rig.drive_v == [0.0]
    assert not device.write([4.0], line.now_ns())
    assert not device.write([4.0], line.now_ns())
    assert rig.drive_v == [0.0]
    flags = frozenset().union(*device.status(line.now_ns()))
    assert flags == {DeviceFlag.WATCHDOG_TRIPPED, DeviceFlag.DISCONNECTED}
    device.close()
    device.open()
    assert list(device.read_back(line.now_ns())) == [0.0]
    device.activate(line.now_ns())
    assert device.write([4.0], line.now_ns())
    device.deactivate(line.now_ns())
    line.time.t_ns += 9000 * MS
    line.receive(0)
    assert rig.drive_v == [pytest.approx(60, abs=0.05)]


@pytest.mark.sees("modbus", "A9")
def test_a_watchdog_that_is_seen_to_have_tripped_ends_writing() -> None:
    """A read that detects the trip makes the next write fail."""
    device, line, rig = opened(emulator.WAGO_750, {"profile": "wago-750", "host": "h", **WATCHED})
    assert device.write([4.0], line.now_ns())
    line.time.t_ns += 2100 * MS
    line.receive(0)
    for _ in range(3):
        device.read(line.now_ns())
        device.read_back(line.now_ns())
        assert not device.write([4.0], line.now_ns())
    assert rig.drive_v == [0.0]


@pytest.mark.sees("modbus", "A9")
def test_a_status_that_piezod_cannot_clear_refuses_until_it_is_cleared() -> None:
    """A trip that lasts after activating does not cause the device to be reopened again and again.

    When the maker's program has cleared it, the outputs must be taken over once more.
    """
    rows = (
        {"role": "input", "channel": "AI0", "table": "input", "address": 0, "type": "int16"},
        DRIVE,
        {"role": "read-back", "channel": "AO0", "address": 0x200},
        TRIPPED,
    )
    options = ModbusOptions.model_validate({"registers": rows, "host": "h"})
    device, line, rig = emulated(emulator.WAGO_750, options, ONE)
    line.open()
    set_by_somebody_else(line, 1, 0x4000)
    device.open()
    device.activate(line.now_ns())
    for _ in range(2):
        assert not device.write([4000.0], line.now_ns())
        assert device.read(line.now_ns())[0].valid
        flags = frozenset().union(*device.status(line.now_ns()))
        assert flags == {DeviceFlag.WATCHDOG_TRIPPED}
    set_by_somebody_else(line, 1, 0)
    for _ in range(2):
        assert not device.write([4000.0], line.now_ns())
        assert DeviceFlag.DISCONNECTED in device.status(line.now_ns())[1]
    assert rig.drive_v == [0.0]
    device.close()
    device.open()
    device.activate(line.now_ns())
    assert device.write([4000.0], line.now_ns())


@pytest.mark.sees("modbus", "A9")
@pytest.mark.parametrize("n_lost", [1, 8])
def test_nothing_is_set_after_an_outage_before_the_status_was_seen(n_lost: int) -> None:
    """A request without reply does not end the silence."""
    device, line, rig = outputs_only()
    assert device.write([4000.0], line.now_ns())
    before = list(rig.drive_v)
    line.time.t_ns += 400 * MS - n_lost * round(TIMEOUT_S * 1e9)
    line.change = lambda _reply: b""
    for _ in range(n_lost):
        assert not device.write([4000.0], line.now_ns())
    line.change = lambda reply: reply
    set_by_somebody_else(line, 1, 0x4000)
    assert not device.write([8000.0], line.now_ns())
    assert rig.drive_v == before
    assert DeviceFlag.WATCHDOG_TRIPPED in device.status(line.now_ns())[0]


@pytest.mark.sees("modbus", "A9")
def test_outputs_without_inputs_are_watched_while_they_are_set() -> None:
    """The status of a device without inputs is read ten times a second; a trip ends writing."""
    device, line, rig = outputs_only()
    line.sent.clear()
    for _ in range(100):
        assert device.write([4000.0], line.now_ns())
        line.time.t_ns += 10 * MS
    assert [frame[7] for frame in line.sent].count(3) == 10
    before = list(rig.drive_v)
    set_by_somebody_else(line, 1, 0x4000)
    for _ in range(11):
        device.write([4000.0], line.now_ns())
        line.time.t_ns += 10 * MS
    assert not device.write([8000.0], line.now_ns())
    assert rig.drive_v == before
    assert DeviceFlag.WATCHDOG_TRIPPED in device.status(line.now_ns())[0]


def test_a_write_is_taken_although_the_status_is_missing() -> None:
    """A failed status request does not fail the write before it, and is reported."""
    device, line, rig = outputs_only()
    line.change = lambda reply: b"" if reply[7] == 3 else reply
    assert device.write([4000.0], line.now_ns())
    assert rig.drive_v == [pytest.approx(150 * 4000 / 0x7FF0, abs=0.05)]
    assert device.status(line.now_ns()) == [frozenset({DeviceFlag.LATE_REPLY})]


def test_a_line_that_goes_after_a_write_is_lost() -> None:
    """A line that is lost at the status request after a write loses the device."""
    device, line, _ = outputs_only()

    def pulled(reply: bytes) -> bytes:
        line.unplugged = reply[7] == 3
        return reply

    line.change = pulled
    assert not device.write([4000.0], line.now_ns())
    assert device.lost
    assert device.status(line.now_ns()) == [frozenset({DeviceFlag.DISCONNECTED})]


@pytest.mark.sees("modbus", "A9")
def test_a_watchdog_that_waits_for_less_is_asked_sooner() -> None:
    """After a silence longer than a short time-out the status is read before anything is set."""
    armed_watchdogs = {"watchdog": {"timeout_s": 0.1, "safe": 0.0}}
    options: dict[str, object] = {"profile": "wago-750", "host": "h", **armed_watchdogs}
    device, line, rig = opened(emulator.WAGO_750, options)
    assert device.write([4.0], line.now_ns())
    line.time.t_ns += 150 * MS
    line.receive(0)
    assert rig.drive_v == [0.0]
    line.sent.clear()
    assert not device.write([4.0], line.now_ns())
    assert [frame[7] for frame in line.sent] == [3]
    assert DeviceFlag.WATCHDOG_TRIPPED in device.status(line.now_ns())[1]


READ_ONLY: list[Any] = [
    *(pytest.param(*case.values[:2], case.values[2].inputs, id=case.id) for case in CASES),
    pytest.param(
        emulator.WAGO_750, {"profile": "wago-750", "host": "h", **WATCHED}, ("AI0",), id="watched"
    ),
]


@pytest.mark.parametrize(("plugin", "options", "inputs"), READ_ONLY)
def test_a_device_of_which_inputs_are_used_is_sent_no_write(
    plugin: EmulatorPlugin, options: dict[str, object], inputs: tuple[str, ...]
) -> None:
    """With inputs only, no output is set and no watchdog is armed or stopped."""
    device, line, _ = opened(plugin, options, Wiring(inputs, ()))
    assert not device.capabilities().watchdog
    assert device.read(line.now_ns())[0].valid
    device.close()
    at = 7 if "host" in options else 1
    assert {frame[at] for frame in line.sent} <= {1, 3, 4}


@pytest.mark.sees("modbus", "S7")
def test_a_saturated_input_is_reported() -> None:
    """An input beyond its range is no sample and sets the flag of its channel only."""
    device, line, rig = opened(emulator.ADAM_6024, {"profile": "adam-6024", "host": "h"})
    rig.valid = False
    line.time.t_ns += 200 * MS
    (sample,) = device.read(line.now_ns())
    assert not sample.valid
    assert device.status(line.now_ns()) == [frozenset({DeviceFlag.SATURATED}), frozenset()]
    rig.valid = True
    line.time.t_ns += 200 * MS
    assert device.read(line.now_ns())[0].valid
    assert device.status(line.now_ns()) == [frozenset(), frozenset()]


def test_another_device_is_refused() -> None:
    """A device without the constants of its profile is refused with the number it holds."""
    device, line, _ = emulated(
        emulator.WAGO_750,
        ModbusOptions.model_validate({"profile": "labjack-t7", "host": "h"}),
        Wiring((), ()),
    )
    with pytest.raises(DeviceError, match="holding 55100 cannot be read, expected 1122867"):
        device.open()
    assert not line.opened
    device, _, _ = emulated(
        emulator.LABJACK_T4,
        ModbusOptions.model_validate({"profile": "labjack-t7", "host": "h"}),
        Wiring((), ()),
    )
    with pytest.raises(DeviceError, match=r"no LabJack T7, .*60000 holds 4, expected 7"):
        device.open()


@pytest.mark.sees("modbus", "B10")
def test_a_missing_register_is_reported_when_the_device_is_opened() -> None:
    """A wrong register map fails at opening, with the exception and the request."""
    row = {"role": "input", "channel": "AI0", "address": 700}
    options = ModbusOptions.model_validate({"registers": (row,), "host": "h"})
    device, _, _ = emulated(emulator.ADAM_6024, options, Wiring(("AI0",), ()))
    with pytest.raises(DeviceUnavailableError, match=r"function 3 .*exception 2"):
        device.open()


def test_forms_that_a_device_refuses_are_not_used() -> None:
    """Forms that read registers that the device lacks are not used after opening."""
    rows = tuple(
        {"role": "input", "channel": f"AI{i}", "address": i, "table": "holding"} for i in range(9)
    )
    options = ModbusOptions.model_validate({"registers": rows, "host": "h"})
    device, line, _ = emulated(emulator.ADAM_6024, options, Wiring(("AI5",), ()))
    device.open()
    device.activate(line.now_ns())
    for _ in range(4):
        assert device.read(line.now_ns())[0].valid
        assert device.status(line.now_ns()) == [frozenset()]


def test_a_form_that_is_refused_is_not_used_in_a_common_request() -> None:
    """If the device refuses the second of three lengths, combined requests use the others."""
    options = ModbusOptions.model_validate({"profile": "wago-750", "host": "h"})
    device, line, _ = emulated(emulator.WAGO_750, options, ONE)
    assert isinstance(device, ExchangingBusDevice)

    def refuses_two(reply: bytes) -> bytes:
        refusal = reply[:4] + b"\0\3" + reply[6:7] + b"\x84\2"
        return refusal if reply[7:9] == b"\4\4" else reply

    line.change = refuses_two
    for _ in range(2):
        device.open()
        device.activate(line.now_ns())
        line.sent.clear()
        for _ in range(4):
            taken, (sample,) = device.exchange([1.0], line.now_ns())
            assert taken
            assert sample.valid
        asked = [frame for frame in line.sent if frame[7] == 23]
        assert {unpack_from(">H", frame, 10)[0] for frame in asked} == {1, 3}
        device.close()


def test_device_that_reports_no_identity() -> None:
    """A module without a version register works, without a firmware in its identity."""
    options = ModbusOptions.model_validate({"unit": 2, "profile": "waveshare-ao8b", "port": "p"})
    device, _, _ = emulated(emulator.ICPDAS, options, Wiring((), ("AO1",)))
    model = "Modbus RTU Analog Output 8CH (B)"
    assert device.open() == ("Waveshare", model, "not told", "not told")


def test_two_outputs_that_are_no_neighbours() -> None:
    """Two outputs that are no neighbours are set in two requests."""
    device, line, rig = opened(
        emulator.ICPDAS, {"units": BOXES, "port": "p"}, Wiring(("AI1",), ("AO2", "AO0"))
    )
    assert device.write([5.0, 3.0], line.now_ns())
    assert rig.drive_v == [pytest.approx(45, abs=0.05), 0.0]
    assert list(device.read_back(line.now_ns())) == pytest.approx([5.0, 3.0])
