from struct import unpack

import pytest

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.driver import make_device
from piezod_drivers.modbus.options import ModbusOptions
from tests.drivers.modbus.emulated import emulated, transactions_over
from tests.drivers.serial_line.linear_rig import LinearRig
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

ONE = Wiring(("AIN0",), ("DAC0",))
WATCHED = {"timeout_s": 2.0, "safe": 0.5}


def labjack(
    watchdog: dict[str, float] | None = None, wiring: Wiring = ONE
) -> tuple[ExchangingBusDevice, EmulatedLine, LinearRig]:
    """Return an active T7, its line and the rig at the other end."""
    options = {"profile": "labjack-t7", "host": "t7", "watchdog": watchdog}
    device, line, rig = emulated(emulator.LABJACK_T7, ModbusOptions.model_validate(options), wiring)
    assert isinstance(device, ExchangingBusDevice)
    device.open()
    device.activate(line.now_ns())
    return device, line, rig


def labjack_at(line: EmulatedLine, watchdog: dict[str, float], wiring: Wiring) -> BusDevice:
    """Return another active device for the same T7."""
    options = {"profile": "labjack-t7", "host": "t7", "watchdog": watchdog}
    model = ModbusOptions.model_validate(options)
    device = make_device(model, wiring, transactions_over(line, model))
    device.open()
    device.activate(line.now_ns())
    return device


def flags(device: ExchangingBusDevice, line: EmulatedLine) -> frozenset[DeviceFlag]:
    """Return the flags of all channels."""
    return frozenset().union(*device.status(line.now_ns()))


def set_by_somebody_else(line: EmulatedLine, address: int, value: bytes) -> None:
    """Write two registers without the driver."""
    line.send(bytes.fromhex("ffff0000000b0110") + address.to_bytes(2, "big") + b"\0\2\4" + value)
    line.receive(MS)


@pytest.mark.parametrize(
    ("plugin", "product", "highest"),
    [
        (emulator.LABJACK_T4, "T4", 5.0),
        (emulator.LABJACK_T7, "T7", 5.0),
        (emulator.LABJACK_T8, "T8", 10.0),
    ],
)
def test_identity(plugin: EmulatorPlugin, product: str, highest: float) -> None:
    """A LabJack reports product, serial number and firmware, and the range of its outputs."""
    options = ModbusOptions.model_validate({"profile": f"labjack-{product.lower()}", "host": "h"})
    device, line, rig = emulated(plugin, options, ONE, "470012345")
    assert device.open() == ("LabJack", product, "470012345", "1.0300")
    device.activate(line.now_ns())
    assert device.write([highest], line.now_ns())
    assert rig.drive_v == [pytest.approx(150)]
    assert not device.write([highest + 0.01], line.now_ns())
    assert not device.write([-0.01], line.now_ns())


def test_a_cycle_is_one_request() -> None:
    """One request sets and reads everything, the read-back included."""
    device, line, rig = labjack()
    line.sent.clear()
    taken, (sample,) = device.exchange([2.0], line.now_ns())
    now_ns = line.now_ns()
    assert taken
    assert sample.position_um == pytest.approx(2.4, abs=1e-3)
    assert rig.drive_v == [pytest.approx(60, abs=0.05)]
    (frame,) = line.sent
    assert frame[7:] == bytes.fromhex(
        "4c 00 03e8 02  01 03e8 02 40000000  00 03e8 02  00 0000 02  00 f03e 02".replace(" ", "")
    )
    device.exchange([2.0], now_ns)
    line.sent.clear()
    assert list(device.read_back(now_ns)) == pytest.approx([2.0], abs=1e-3)
    assert line.sent == []
    assert list(device.read_back(now_ns + 1)) == pytest.approx([2.0], abs=1e-3)
    assert len(line.sent) == 1


def test_two_axes() -> None:
    """Inputs and outputs may be in any order and are never mixed up."""
    device, line, rig = labjack(wiring=Wiring(("AIN1", "AIN0"), ("DAC1", "DAC0")))
    taken, samples = device.exchange([1.0, 4.0], line.now_ns())
    assert taken
    assert rig.drive_v == pytest.approx([120, 30], abs=0.05)
    assert [sample.position_um for sample in samples] == pytest.approx([1.2, 4.8], abs=0.01)


def test_a_saturated_input_is_no_sample() -> None:
    """An invalid reading, -9999, is reported as saturated."""
    device, line, rig = labjack()
    rig.valid = False
    assert not device.read(line.now_ns())[0].valid
    assert device.status(line.now_ns())[0] == {DeviceFlag.SATURATED}


@pytest.mark.sees("modbus", "S7")
@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0)])
def test_an_input_of_a_t4_saturates_at_the_end_of_its_own_range(order: tuple[int, ...]) -> None:
    """AIN0 to AIN3 end at 10 V and the others at 2.5 V, in any order of use."""
    wiring = Wiring(tuple(f"AIN{i}" for i in order), ())
    options = ModbusOptions.model_validate({"profile": "labjack-t4", "host": "h"})
    device, line, rig = emulated(emulator.LABJACK_T4, options, wiring)
    device.open()
    device.activate(line.now_ns())
    rig.drive_v = [60.0] * 5
    assert [sample.position_um for sample in device.read(line.now_ns())] == pytest.approx([2.4] * 5)
    assert device.status(line.now_ns()) == [frozenset()] * 5
    rig.drive_v = [75.0] * 5
    by_name = dict(zip(wiring.inputs, device.read(line.now_ns()), strict=True))
    assert not by_name.pop("AIN4").valid
    assert [sample.position_um for sample in by_name.values()] == pytest.approx([3.0] * 4)
    flags = dict(zip(wiring.inputs, device.status(line.now_ns()), strict=True))
    assert flags.pop("AIN4") == {DeviceFlag.SATURATED}
    assert set(flags.values()) == {frozenset()}


@pytest.mark.sees("modbus", "A9")
def test_the_watchdog_makes_the_output_safe_when_we_die() -> None:
    """After 2 s of silence the output is at the safe voltage, and nothing is set any more.

    Setting it would be a jump. When the device was opened again and its output was read, writes are
    accepted.
    """
    device, line, rig = labjack(WATCHED)
    assert device.capabilities().watchdog
    assert device.write([2.0], line.now_ns())
    line.time.t_ns += 1700 * MS
    assert device.exchange([2.1], line.now_ns())[0]
    assert rig.drive_v == [pytest.approx(63, abs=0.05)]
    line.time.t_ns += 2100 * MS
    line.receive(0)
    assert rig.drive_v == [pytest.approx(15, abs=0.05)]
    assert not device.exchange([2.1], line.now_ns())[0]
    assert {DeviceFlag.WATCHDOG_TRIPPED, DeviceFlag.DISCONNECTED} == flags(device, line)
    assert not device.exchange([2.1], line.now_ns())[0]
    assert not device.write([2.1], line.now_ns())
    assert rig.drive_v == [pytest.approx(15, abs=0.05)]
    device.close()
    device.open()
    assert list(device.read_back(line.now_ns())) == pytest.approx([0.5], abs=2e-3)
    device.activate(line.now_ns())
    assert device.exchange([0.6], line.now_ns())[0]
    assert flags(device, line) == frozenset()


@pytest.mark.sees("modbus", "A9")
def test_a_watchdog_that_is_seen_to_have_tripped_ends_writing() -> None:
    """A read after the silence detects the trip, and the next write is refused."""
    device, line, rig = labjack(WATCHED)
    assert device.write([2.0], line.now_ns())
    line.time.t_ns += 2100 * MS
    line.receive(0)
    for _ in range(3):
        device.read(line.now_ns())
        device.read_back(line.now_ns())
        assert not device.write([2.0], line.now_ns())
    assert rig.drive_v == [pytest.approx(15, abs=0.05)]


@pytest.mark.sees("modbus", "A9")
def test_driver_stopped_before_the_reply_counts_as_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A process stopped during an exchange reads the outputs before it sets them again."""
    device, line, rig = labjack(WATCHED)
    receive = line.receive

    def stopped(within_ns: int) -> bytes:
        data = receive(within_ns)
        line.time.t_ns += 2100 * MS if data else 0
        return data

    with monkeypatch.context() as patch:
        patch.setattr(line, "receive", stopped)
        assert device.exchange([2.0], line.now_ns())[0]
    line.receive(0)
    assert rig.drive_v == [pytest.approx(15, abs=0.05)]
    assert not device.exchange([2.0], line.now_ns())[0]
    assert rig.drive_v == [pytest.approx(15, abs=0.05)]


@pytest.mark.parametrize(("armed", "end_v"), [(None, 60), (WATCHED, 15)])
def test_read_only_use_leaves_outputs_and_watchdog_alone(
    armed: dict[str, float] | None, end_v: float
) -> None:
    """With inputs only, no watchdog is armed and no armed one is stopped."""
    device, line, rig = labjack(armed)
    assert device.write([2.0], line.now_ns())
    line.sent.clear()
    reader = labjack_at(line, WATCHED, Wiring(("AIN0",), ()))
    assert not reader.capabilities().watchdog
    assert reader.read(line.now_ns())[0].valid
    reader.close()
    asked = [frame for frame in line.sent if frame[7] != 3]
    assert asked
    assert all(frame[7] == 0x4C and frame[8::4] == bytes(len(frame[8::4])) for frame in asked)
    line.open()
    line.time.t_ns += 9000 * MS
    line.receive(0)
    assert rig.drive_v == [pytest.approx(end_v, abs=0.05)]


def test_a_silence_without_consequences_is_none() -> None:
    """If the outputs have not changed, the first write after a silence is accepted."""
    device, line, _ = labjack(WATCHED)
    assert device.write([2.0], line.now_ns())
    line.time.t_ns += 1950 * MS
    assert device.write([2.1], line.now_ns())
    assert flags(device, line) == frozenset()


def test_the_watchdog_is_stopped_in_the_end() -> None:
    """A device that was closed normally holds its output."""
    device, line, rig = labjack(WATCHED)
    assert device.write([2.0], line.now_ns())
    device.close()
    line.open()
    line.time.t_ns += 9000 * MS
    line.receive(0)
    assert rig.drive_v == [pytest.approx(60, abs=0.05)]


def test_an_armed_watchdog_is_not_written_again() -> None:
    """Settings in flash memory that are already right are not written."""
    device, line, _ = labjack(WATCHED)
    writes = [frame for frame in line.sent if frame[7] == 16]
    assert [unpack(">H", frame[8:10])[0] for frame in writes[:1] + writes[-1:]] == [61600, 61600]
    line.sent.clear()
    device._active = False  # noqa: SLF001 - as after the death of a process
    device.activate(line.now_ns())
    assert all(frame[7] == 3 for frame in line.sent)


@pytest.mark.sees("modbus", "A9")
def test_a_watchdog_that_cannot_be_armed_is_refused() -> None:
    """A device that does not hold the watchdog's settings is not activated."""
    options = ModbusOptions.model_validate(
        {"profile": "labjack-t7", "host": "h", "watchdog": WATCHED}
    )
    device, line, _ = emulated(emulator.LABJACK_T7, options, ONE)
    device.open()
    two = bytes.fromhex("03 04 00 00 00 02")
    line.change = lambda reply: reply[:-1] + b"\7" if reply[7:] == two else reply
    with pytest.raises(DeviceError, match=r"cannot be armed: register 61604 holds 7 instead of 2"):
        device.activate(line.now_ns())


@pytest.mark.sees("modbus", "A8")
def test_write_of_another_program_is_noticed() -> None:
    """An output that changed between two exchanges is reported."""
    device, line, _ = labjack()
    device.exchange([2.0], line.now_ns())
    set_by_somebody_else(line, 1000, bytes.fromhex("3f800000"))
    device.exchange([2.0], line.now_ns())
    assert flags(device, line) == {DeviceFlag.LOCAL_MODE}
    device.exchange([2.0], line.now_ns())
    assert flags(device, line) == frozenset()


@pytest.mark.sees("modbus", "A7")
def test_a_restart_is_noticed() -> None:
    """A counter that went back reveals a restart, also over a new connection."""
    device, line, _ = labjack()
    line.time.t_ns += 60_000 * MS
    device.read(line.now_ns())
    device.close()
    line.change = lambda reply: reply[:-4] + bytes(4) if reply[7] == 0x4C else reply
    device.open()
    device.activate(line.now_ns())
    device.read(line.now_ns())
    assert DeviceFlag.RESTARTED in flags(device, line)


def test_words_in_the_wrong_order_are_noticed() -> None:
    """A device without the constant 0x00112233 is refused: no LabJack, or another word order."""
    options = ModbusOptions.model_validate({"profile": "labjack-t7", "host": "h"})
    device, line, _ = emulated(emulator.LABJACK_T7, options, ONE)
    line.change = lambda reply: reply[:-4] + reply[-2:] + reply[-4:-2]
    with pytest.raises(DeviceError, match="55100 holds 573767697, expected 1122867"):
        device.open()
    line.absent = True
    with pytest.raises(DeviceUnavailableError):
        device.open()
