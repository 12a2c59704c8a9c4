"""The profiles against tables of the makers' manuals, and the devices that they refuse."""

from functools import partial
from typing import Any

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.checksum import with_checksum
from piezod_drivers.modbus.emulation import io_modules
from piezod_drivers.modbus.emulation.servers import RtuServer
from piezod_drivers.modbus.emulation.unit import EmulatedUnit
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.profiles import PROFILES
from piezod_drivers.modbus.register import Register, packer, unpacker
from tests.drivers.modbus.emulated import emulated
from tests.drivers.serial_line.scripted_line import EmulatedLine

ADAM: dict[str, object] = {"profile": "adam-4024", "port": "p"}
WAVESHARE = ({"unit": 1, "profile": "waveshare-ai8b"}, {"unit": 2, "profile": "waveshare-ao8b"})
ICPDAS = ({"unit": 1, "profile": "icpdas-m7017"}, {"unit": 2, "profile": "icpdas-m7024"})
WAGO: dict[str, object] = {"profile": "wago-750", "host": "h"}
ONE = Wiring(("AI0",), ("AO0",))


def made(
    plugin: EmulatorPlugin, options: dict[str, object], wiring: Wiring
) -> tuple[BusDevice, EmulatedLine, Any]:
    """Return a device that is not open, its line and the rig at the other end."""
    return emulated(plugin, ModbusOptions.model_validate(options), wiring)


def set_register(line: EmulatedLine, unit: int, address: int, number: int) -> None:
    """Write a holding register without the driver, over RTU."""
    pdu = bytes((unit, 6, *address.to_bytes(2, "big"), *number.to_bytes(2, "big")))
    line.open()
    line.send(with_checksum(pdu))
    line.receive(1_000_000)
    line.close()


def register(profile: str, role: str, channel: str) -> Register:
    """Return the register of a channel."""
    (found,) = (
        each
        for each in PROFILES[profile].registers
        if each.role == role and each.channel == channel
    )
    return found


def test_0_v_of_an_adam_4024_is_0_v() -> None:
    """0 V at its outputs of ±10 V is the middle of their codes, not code 0."""
    device, line, rig = made(emulator.ADAM_4024, ADAM, Wiring((), ("AO0",)))
    device.open()
    device.activate(line.now_ns())

    assert device.write([0.0], line.now_ns())
    assert rig.drive_v == [pytest.approx(0.0, abs=15 * 10 / 4095)]
    assert device.write([10.0], line.now_ns())
    assert rig.drive_v == [150.0]
    assert list(device.read_back(line.now_ns())) == [10.0]


@pytest.mark.parametrize("code", [0x30, 0x31, 0])
def test_an_adam_4024_with_an_output_of_another_type_is_refused(code: int) -> None:
    """An output for a current, or of an unknown type, is not opened."""
    device, line, _ = made(emulator.ADAM_4024, ADAM, Wiring((), ("AO1",)))
    set_register(line, 1, 201, code)

    with pytest.raises(DeviceError, match=f"holding 201 holds {code}, expected 50; set output 1 "):
        device.open()


def test_type_of_an_unused_output_does_not_matter() -> None:
    """Only the used outputs must be of the type -10 to 10 V."""
    device, line, _ = made(emulator.ADAM_4024, ADAM, Wiring((), ("AO0",)))
    set_register(line, 1, 201, 0x30)

    assert device.open().model == "ADAM-4024"


@pytest.mark.confirms(
    "modbus",
    "adam-4024",
    part="registers, types of outputs",
    by="ADAM-4000 manual, p. 6-20 and G-7",
    kind="manual",
)
def test_adam_4024_has_the_registers_of_its_manual() -> None:
    """Values are at 40001 to 40004, types at 40201, name at 40211, watchdog flag at 40216."""
    profile = PROFILES["adam-4024"]
    table = {40001 + i: f"AO{i}" for i in range(4)}

    assert {
        40001 + each.address: each.channel for each in profile.registers if each.role == "output"
    } == table
    assert {40001 + each.address: each.number for each in profile.constants} == {
        40211: 0x4024,
        **{40201 + i: 0x32 for i in range(4)},  # 0x32: -10 to 10 V
    }
    assert [40001 + each.address for each in profile.registers if each.role == "status"] == [40216]


@pytest.mark.confirms(
    "modbus",
    "adam-6024",
    part="registers",
    by="ADAM-6000 manual, B.2.4",
    kind="manual",
)
def test_adam_6024_has_the_registers_of_its_manual() -> None:
    """Inputs are at 40001, outputs at 40011, the status of the inputs at 40021."""
    for i in range(6):
        assert 40001 + register("adam-6024", "input", f"AI{i}").address == 40001 + i
        assert 40001 + register("adam-6024", "status", f"AI{i}").address == 40021 + i
    for i in range(2):
        assert 40001 + register("adam-6024", "output", f"AO{i}").address == 40011 + i
    pack = packer(register("adam-6024", "output", "AO0"))
    read = unpacker(register("adam-6024", "input", "AI0"))
    scale, offset = (getattr(register("adam-6024", "input", "AI0"), n) for n in ("scale", "offset"))

    assert (pack(0.0), pack(10.0)) == (b"\x00\x00", b"\x0f\xff")
    assert [scale * read(word, 0) + offset for word in (b"\0\0", b"\xff\xff")] == [-10.0, 10.0]


@pytest.mark.confirms(
    "modbus",
    "wago-750",
    part="refusal of a PFC, which has the constants but no item number",
    by="WAGO pfc-howtos, kbusmodbusslave 1.6.0 (modbus.c)",
    kind="manual",
)
@pytest.mark.parametrize("item", [8100, 8206, 8216, None])
def test_a_pfc_is_refused(item: int | None) -> None:
    """A PFC100 or PFC200 is no coupler: by its item number, or because it reports none."""
    plugin = EmulatorPlugin("pfc", "PFC", "tcp", partial(io_modules.wago_750, item=item))
    device, _, rig = made(plugin, WAGO, ONE)

    with pytest.raises(DeviceError, match="PFC100 or PFC200") as refusal:
        device.open()
    assert not isinstance(refusal.value, DeviceUnavailableError)
    assert rig.driven_v == []


@pytest.mark.parametrize("item", [315, 341, 352, 362, 841, 881])
def test_couplers_and_controllers_are_accepted(item: int) -> None:
    """Couplers 750-3xx and controllers 750-8xx have the registers of the profile."""
    plugin = EmulatorPlugin("coupler", "750", "tcp", partial(io_modules.wago_750, item=item))
    device, _, _ = made(plugin, WAGO, ONE)

    assert device.open().model == f"750-{item}"


@pytest.mark.confirms(
    "modbus",
    "wago-750",
    part="registers, watchdog",
    by="750-880 manual, table 130 (p. 242); WAGO pfc-howtos",
    kind="manual",
)
def test_wago_has_the_registers_of_its_manual() -> None:
    """Watchdog and constants have the addresses and numbers of the manual."""
    profile = PROFILES["wago-750"]
    assert profile.watchdog is not None
    stop, settings = profile.watchdog.off, profile.watchdog.settings(2.0, 0.0)

    assert [(each.address, each.number in {0x55AA, 0xAA55}) for each in stop] == [(0x1008, True)]
    assert [(each.address, each.number) for each in settings] == [(0x1000, 20), (0x1001, 0xFFFF)]
    assert [each.address for each in profile.watchdog.on] == [0x1003, 0x1006]
    assert {each.address: each.number for each in profile.constants[:9]} == dict(
        zip(
            range(0x2000, 0x2009),
            (0x0000, 0xFFFF, 0x1234, 0xAAAA, 0x5555, 0x7FFF, 0x8000, 0x3FFF, 0x4000),
            strict=True,
        )
    )
    assert register("wago-750", "read-back", "AO0").address == 0x0200


@pytest.mark.parametrize("code", [0x09, 0x0A, 0x0D])
def test_an_m_7017_with_another_range_is_refused(code: int) -> None:
    """±5 V, ±1 V and ±20 mA have other scales."""
    device, line, _ = made(emulator.ICPDAS, {"units": ICPDAS, "port": "p"}, ONE)
    set_register(line, 1, 486, code)

    with pytest.raises(DeviceError, match=f"486 holds {code}, expected 8; .* an M-7017C measures"):
        device.open()


@pytest.mark.confirms(
    "modbus",
    "icpdas-m7017",
    part="registers",
    by="quick start guides of M-7017C and tM-AD4P2C2",
    kind="manual",
)
@pytest.mark.confirms(
    "modbus",
    "icpdas-m7024",
    part="functions, addresses of outputs",
    by="I-7021/22/24 manual B2.3, 3.8 (p. 161)",
    kind="manual",
)
def test_icp_das_has_the_registers_of_its_manuals() -> None:
    """Inputs are at 30001 to 30008, outputs at the addresses 0 to 3, the firmware at 40481."""
    for i in range(8):
        each = register("icpdas-m7017", "input", f"AI{i}")
        assert (each.table, 30001 + each.address) == ("input", 30001 + i)
    for i in range(4):
        assert register("icpdas-m7024", "output", f"AO{i}").address == i
    for name in ("icpdas-m7017", "icpdas-m7024"):
        fields = dict(PROFILES[name].identity_fields)
        assert 40001 + fields["firmware"].address == 40481
    assert PROFILES["icpdas-m7024"].write_functions == (6, 16)


@pytest.mark.parametrize("mode", [1, 2, 3, 4])
def test_a_waveshare_input_in_another_mode_is_refused(mode: int) -> None:
    """2 to 10 V, currents and raw codes are not taken for 0 to 10 V."""
    wiring = Wiring(("AI2",), ("AO1",))
    device, line, _ = made(emulator.WAVESHARE, {"units": WAVESHARE, "port": "p"}, wiring)
    set_register(line, 1, 0x1001, mode)

    with pytest.raises(DeviceError, match=f"4097 holds {mode}, expected 0; set input 2 to mode 0"):
        device.open()


@pytest.mark.confirms(
    "modbus", "waveshare-ai8", part="modes, addresses", by="wiki, table of modes", kind="manual"
)
@pytest.mark.confirms(
    "modbus", "waveshare-ai8b", part="modes, addresses", by="wiki, table of modes", kind="manual"
)
def test_waveshare_inputs_have_the_modes_of_the_wiki() -> None:
    """Mode 0 is a voltage, mode 2 is 0 to 20 mA; the mode of input n is at 0x0FFF + n."""
    for name, mode in (("waveshare-ai8", 2), ("waveshare-ai8b", 0)):
        modes = {each.channel: (each.address, each.number) for each in PROFILES[name].constants}
        assert modes == {f"AI{i}": (0x0FFF + i, mode) for i in range(1, 9)}
        assert register(name, "input", "AI1").address == 0


@pytest.mark.confirms(
    "modbus", "waveshare-ao8", part="frames, scale", by="wiki, example of 1 mA", kind="manual"
)
@pytest.mark.confirms(
    "modbus", "waveshare-ao8b", part="scale", by="wiki, outputs in mV", kind="manual"
)
def test_waveshare_outputs_send_the_frame_of_the_wiki() -> None:
    """1 mA at output 1 is the frame 01 06 00 00 03 E8 89 74; 10 V of the (B) version are 10000."""
    options: dict[str, object] = {"profile": "waveshare-ao8", "port": "p"}
    plugin = EmulatorPlugin("ao8", "AO8", "serial", _analog_output)
    device, line, _ = made(plugin, options, Wiring((), ("AO1",)))
    device.open()
    device.activate(line.now_ns())
    assert device.write([1.0], line.now_ns())

    assert bytes.fromhex("0106000003E88974") in line.sent
    assert packer(register("waveshare-ao8b", "output", "AO1"))(10.0) == (10_000).to_bytes(2, "big")


def _analog_output(bench: Any, _serial: str) -> Any:
    """Construct an output module at address 1 that stores what it is sent."""
    unit = EmulatedUnit(frozenset({3, 6, 16}))
    for i in range(8):
        unit.add_stored("holding", i, "uint16")
    unit.add_stored("holding", 0x8000, "uint16", 100)
    return RtuServer({1: unit}, bench.now_ns)


@pytest.mark.parametrize(("name", "highest_v"), [("t4", 5.0), ("t7", 5.0), ("t8", 10.0)])
@pytest.mark.confirms(
    "modbus",
    "labjack-t4",
    part="registers",
    by="LabJack's ljm_constants 2025.12.18.A",
    kind="manual",
)
@pytest.mark.confirms(
    "modbus",
    "labjack-t7",
    part="registers",
    by="LabJack's ljm_constants 2025.12.18.A",
    kind="manual",
)
@pytest.mark.confirms(
    "modbus",
    "labjack-t8",
    part="registers",
    by="LabJack's ljm_constants 2025.12.18.A",
    kind="manual",
)
def test_labjack_has_the_registers_of_its_map(name: str, highest_v: float) -> None:
    """AINn is at 2n, DACn at 1000 + 2n, the test register at 55100, the watchdog at 61600."""
    profile = PROFILES[f"labjack-{name}"]
    assert profile.watchdog is not None
    addresses = {each.channel: each.address for each in profile.registers}

    assert all(addresses[f"AIN{n}"] == 2 * n for n in range(8))
    assert (addresses["DAC0"], addresses["DAC1"]) == (1000, 1002)
    assert register(f"labjack-{name}", "output", "DAC0").range == (0.0, highest_v)
    assert {each.address: each.number for each in profile.constants} == {
        55100: 0x00112233,
        60000: int(name[1:]),
    }
    assert [each.address for each in profile.watchdog.on] == [61600]
    assert [each.address for each in profile.watchdog.settings(1.0, 0.0)] == [
        61604, 61640, 61642, 61650, 61652,
    ]  # fmt: skip
