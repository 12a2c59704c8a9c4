"""Cubes and drivers agree with the examples and tables of the maker's protocol document.

Every row of bytes is from "Thorlabs Motion Controllers Host-Controller Communications Protocol",
issue 28, with its page. An example with an address of a bay is repeated with that of a USB device.
"""

import pytest

from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import Id
from piezod_drivers.serial_line.thorlabs_apt.emulator import TRAVEL_UM, KpzEmulator, KsgEmulator
from tests.drivers.serial_line.apt_bench import NOW, instead, kpz, ksg, show
from tests.drivers.serial_line.linear_rig import bench

READING = bytes.fromhex("DE 07 06 00 81 50 01 00 52 00 50 00")  # p. 218
TRAVEL = bytes.fromhex("51 06 04 00 81 50 01 00 C8 00")  # p. 203: 20 µm
SET_VOLTAGE_MODE = bytes.fromhex(  # p. 217: display voltage
    "DA 07 0E 00 D0 01 01 00 01 00 02 00 30 75 00 00 00 00 00 00"
)
SENT = [
    ("DB 07 01 00 50 01", codec.short(Id.REQ_GAUGE_IO, 1)),  # p. 217
    ("DD 07 01 00 50 01", codec.short(Id.REQ_READING, 1)),  # p. 218
    ("50 06 01 00 50 01", codec.short(Id.REQ_MAX_TRAVEL, 1)),  # p. 203
    ("62 06 00 00 50 01", codec.short(Id.ACK_STATUS)),  # p. 183
    ("41 06 01 00 50 01", codec.short(Id.REQ_CONTROL_MODE, 1)),  # p. 172
    ("44 06 01 00 50 01", codec.short(Id.REQ_OUTPUT, 1)),  # p. 174
    ("53 06 01 00 50 01", codec.short(Id.REQ_SOURCE, 1)),  # p. 176
    ("D5 07 01 00 50 01", codec.short(Id.REQ_IO, 1)),  # p. 201
]
SET_70_V_OF_75 = bytes.fromhex("43 06 04 00 D0 01 01 00 77 77")  # p. 174
LIMITS_V = {0x01: 75, 0x02: 100, 0x03: 150}  # p. 200


@pytest.mark.parametrize(("theirs", "ours"), SENT)
def test_requests_are_those_of_the_document(theirs: str, ours: bytes) -> None:
    """The requests to both kinds of cubes, and the sign of life, are those of the document."""
    assert ours == bytes.fromhex(theirs)


def test_example_reading_has_the_scale_of_the_document() -> None:
    """The example reading of 82 is 82/32767 of the example travel of 20 µm."""
    device, line, _, _ = ksg()
    examples = {Id.GET_READING: READING, Id.GET_MAX_TRAVEL: TRAVEL}
    line.change = lambda reply: examples.get(Id(codec.ident_of(reply)), reply)
    device.open()
    device.activate(NOW)
    assert device.read(NOW)[0].position_um == pytest.approx(82 / 32767 * 20.0)


def test_emulated_reader_answers_as_the_document() -> None:
    """The emulated reader has the document's frames, and 32767 is its travel."""
    stand, rig, _ = bench()
    reader = KsgEmulator(stand, "")
    rig.at_um = [TRAVEL_UM / 2]
    (reading,) = reader.receive(bytes.fromhex(SENT[1][0]))
    assert reading[:8] == READING[:8]
    assert len(reading) == len(READING)
    assert int.from_bytes(reading[8:10], "little", signed=True) == round(32767 / 2)
    (travel,) = reader.receive(bytes.fromhex(SENT[2][0]))
    assert travel == TRAVEL[:8] + round(TRAVEL_UM / 0.1).to_bytes(2, "little")


def test_emulated_reader_keeps_the_display_mode_of_the_document() -> None:
    """The example that sets the display to volts is answered by the same settings."""
    stand, _, _ = bench()
    reader = KsgEmulator(stand, "")
    assert reader.receive(SET_VOLTAGE_MODE) == []
    (settings,) = reader.receive(bytes.fromhex(SENT[0][0]))
    assert settings == bytes.fromhex("DC 07 0E 00 81 50") + SET_VOLTAGE_MODE[6:]
    assert codec.display_mode_of(settings) == 2
    show(reader, codec.DisplayMode.POSITION)
    assert codec.display_mode_of(reader.receive(bytes.fromhex(SENT[0][0]))[0]) == 1


@pytest.mark.parametrize(("code", "limit_v"), LIMITS_V.items())
def test_range_is_the_limit_of_the_document(code: int, limit_v: int) -> None:
    """The voltage limit is reported by the codes of the document, and is the range."""
    device, line, _, _ = kpz()
    settings = bytes.fromhex("D6 07 0A 00 81 50 01 00 00 00 01 00 00 00 00 00")
    line.change = instead(Id.GET_IO, settings[:8] + bytes((code, 0)) + settings[10:])
    device.open()
    assert device.capabilities().ranges == ((0.0, float(limit_v)),)


def test_example_voltage_is_sent_as_in_the_document() -> None:
    """70 V at an amplifier with a limit of 75 V are the bytes of the example."""
    device, line, _, _ = kpz()
    limit_75_v = bytes.fromhex("D6 07 0A 00 81 50 01 00 01 00 01 00 00 00 00 00")
    line.change = instead(Id.GET_IO, limit_75_v)
    device.open()
    device.activate(NOW)
    assert device.write([70.0], NOW)
    assert SET_70_V_OF_75 in line.sent[-1]


def test_emulated_amplifier_falls_silent_as_the_document() -> None:
    """An amplifier sends 50 statuses without a sign of life of its host, and then none (p. 183)."""
    stand, _, _ = bench()
    amplifier = KpzEmulator(stand, "")
    request = codec.short(Id.REQ_STATUS, 1)
    assert sum(len(amplifier.receive(request)) for _ in range(60)) == 50
    amplifier.receive(bytes.fromhex(SENT[3][0]))
    assert len(amplifier.receive(request)) == 1
