"""Tables and examples of manuals and of public code by others, for serial devices."""

import re

import pytest

from piezod.devices.status import DeviceFlag, Flags
from piezod_drivers.serial_line.micro_epsilon import codec as stream
from piezod_drivers.serial_line.micro_epsilon.emulator import word_of
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES
from piezod_drivers.serial_line.npoint_lc400 import codec as lc400
from piezod_drivers.serial_line.npoint_lc400.codec import Lc400Register
from piezod_drivers.serial_line.pi_gcs1.codec import Gcs1Syntax
from piezod_drivers.serial_line.pi_gcs2.codec import Gcs2Syntax
from piezod_drivers.serial_line.psj import codec as psj
from piezod_drivers.serial_line.psj.profiles import PROFILES as PSJ_PROFILES

RANGE_UM = 10_000.0


@pytest.mark.parametrize("model", ["ILD1220", "ILD1320", "ILD1420"])
@pytest.mark.confirms(
    "micro_epsilon",
    ("ILD1220", "ILD1320", "ILD1420"),
    part="scale, measuring range, bit rate",
    by="ILD1420 manual, p. 65; IF2035-PROFINET manual, p. 53",
    kind="manual",
)
def test_ild1x20_has_the_scale_of_its_manual(model: str) -> None:
    """The distance is (102/65520 · x - 1)/100 · MR, for x from 643 to 64877."""
    profile = PROFILES[model]
    for x in (643, 10_000, 32_760, 64_877):
        found_um, flags = profile.read(x, RANGE_UM)
        assert found_um == pytest.approx((102 / 65_520 * x - 1) / 100 * RANGE_UM)
        assert not flags
    for x in (0, 642, 64_878, 65_520):
        assert profile.read(x, RANGE_UM)[1] == {DeviceFlag.SATURATED}
    assert (profile.baud, profile.word_bytes) == (921_600, 3)


@pytest.mark.parametrize("model", ["ILD1750", "ILD1900"])
@pytest.mark.confirms(
    "micro_epsilon",
    ("ILD1750", "ILD1900"),
    part="scale, range of values, bit rate",
    by="IF2030/ENETIP manual, p. 37 and 38",
    kind="manual",
)
def test_ild1750_and_1900_have_the_scale_of_the_manual(model: str) -> None:
    """The distance is (x - 98232)/65536 · MR, for x from 0 to 230604."""
    profile = PROFILES[model]
    for x in (0, 98_232, 163_768, 230_604):
        found_um, flags = profile.read(x, RANGE_UM)
        assert found_um == pytest.approx((x - 98_232) / 65_536 * RANGE_UM)
        assert not flags
    assert profile.read(230_605, RANGE_UM)[1] == {DeviceFlag.SATURATED}
    assert (profile.baud, profile.word_bytes) == (921_600, 3)


@pytest.mark.confirms(
    "micro_epsilon",
    "ODC2520",
    part="scale, first error value, bit rate",
    by="IF2035-PROFINET manual, p. 61",
    kind="manual",
)
def test_odc2520_has_the_scale_of_the_manual() -> None:
    """The position is d - 131000 in µm; values from 262072 on are errors."""
    profile = PROFILES["ODC2520"]
    for d in (0, 131_000, 131_026, 262_071):
        assert profile.read(d, RANGE_UM) == (d - 131_000, frozenset())
    assert profile.first_code == 262_072
    assert profile.baud == 115_200


@pytest.mark.confirms(
    "micro_epsilon",
    ("ILD1220", "ILD1320", "ILD1420", "ILD1750", "ILD1900", "ODC2520"),
    part="words of 18 bits, additional values",
    by="IF2030/ENETIP manual, p. 19; ILD1420 manual, p. 84",
    kind="manual",
)
def test_words_of_three_bytes_are_those_of_the_manual() -> None:
    """01 4C CA is 0xA301, an additional value; 2A 40 BF is 0x3F02A, a first one."""
    additional, first = bytes.fromhex("014cca"), bytes.fromhex("2a40bf")

    assert (stream.count_of(additional), stream.count_of(first)) == (0xA301, 0x3F02A)
    assert stream.newest(first + additional, 3) == (0x3F02A, b"", False)
    assert word_of(0xA301, 3, additional=True) == additional


@pytest.mark.confirms(
    "micro_epsilon",
    ("ILD1402", "ILD1700"),
    part="words of 14 bits",
    by="ILD1700 manual, p. 61; ILD1402 manual, p. 34",
    kind="manual",
)
def test_words_of_two_bytes_are_those_of_the_manual() -> None:
    """The digital value 2099 is sent as 90 33."""
    assert stream.newest(b"\x90\x33", 2) == (2099, b"", False)
    assert word_of(2099, 2) == b"\x90\x33"


ERRORS_2: tuple[tuple[int, Flags], ...] = (
    (16_370, frozenset({DeviceFlag.LOW_LIGHT})),  # no object detected
    (16_372, frozenset({DeviceFlag.SATURATED})),  # too close to the sensor
    (16_374, frozenset({DeviceFlag.SATURATED})),  # too far from it
    (16_376, frozenset({DeviceFlag.LOW_LIGHT})),  # the object cannot be evaluated
    (16_378, frozenset({DeviceFlag.LOW_LIGHT})),  # the laser is off
)


@pytest.mark.confirms(
    "micro_epsilon", "ILD1700", part="scale, error codes", by="ILD1700 manual, p. 58", kind="manual"
)
def test_ild1700_has_the_examples_of_its_manual() -> None:
    """For a range of 10 mm 8184 is 5 mm, 10261 is 6.294 mm, 161 is 0 mm; errors follow."""
    profile = PROFILES["ILD1700"]
    for digital, expected_mm in ((8184, 5.0), (10_261, 6.294), (161, 0.0)):
        found_um, flags = profile.read(digital, RANGE_UM)
        assert found_um / 1000 == pytest.approx(expected_mm, abs=5e-4)
        assert not flags
    assert [profile.read(code, RANGE_UM)[1] for code, _ in ERRORS_2] == [f for _, f in ERRORS_2]


@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="addresses, commands, full scale",
    by="EPICS module motorNPoint (LC400MemoryAddr.h, LC400MotorDriver.cpp)",
    kind="manual",
)
def test_lc400_has_the_addresses_of_the_epics_module() -> None:
    """Channels are at 0x1183n000, with these offsets; a range is 1048574 counts."""
    offsets = {
        Lc400Register.RANGE: 0x078,
        Lc400Register.RANGE_TYPE: 0x044,
        Lc400Register.SETPOINT: 0x218,
        Lc400Register.POSITION: 0x334,
        Lc400Register.SERVO: 0x084,
    }
    for channel, base in ((1, 0x11831000), (2, 0x11832000), (3, 0x11833000)):
        for register, offset in offsets.items():
            assert lc400.register_address(channel, register) == base + offset
    assert lc400.FULL_SCALE == 1_048_574
    assert (lc400.FIRMWARE, lc400.FIRMWARE_WORDS) == (0x11830028, 5)
    assert lc400.read(0x11831334) == b"\xa0\x34\x13\x83\x11\x55"
    assert lc400.write(0x11831218, 1) == b"\xa2\x18\x12\x83\x11\x01\0\0\0\x55"


@pytest.mark.confirms(
    "pi_gcs1",
    "pi-e816",
    part="form of commands and of numbers",
    by="EPICS module motorBase, README_PIE516",
    kind="manual",
)
def test_gcs_1_has_the_form_of_the_epics_module() -> None:
    """The letter directly precedes the value; a position is +0000.0000 without a letter."""
    syntax = Gcs1Syntax()
    (pattern,) = syntax.numbers(["A"])

    assert syntax.query("POS?", ["A"]) == b"POS? A\n"
    assert syntax.setting("SVO", ["A"], ["1"]) == b"SVO A1\n"
    assert re.fullmatch(pattern, "+0000.0000\n")
    assert re.fullmatch(syntax.switches(["A"])[0], "1\n")


@pytest.mark.confirms(
    "pi_gcs2", "pi-gcs2", part="form of commands", by="E-727 manual, p. 178", kind="manual"
)
def test_gcs_2_has_the_form_of_the_manual() -> None:
    """Spaces separate mnemonic and arguments, a line feed ends the line."""
    syntax = Gcs2Syntax()

    assert syntax.query("POS?", ["1", "2"]) == b"POS? 1 2\n"
    assert syntax.setting("SVA", ["1", "2"], ["2.5", "3.1"]) == b"SVA 1 2.5 2 3.1\n"


@pytest.mark.confirms(
    "psj",
    ("ddrive", "30dv"),
    part="commands, greeting, ends of lines, status bits",
    by="psj-lib of piezosystem jena",
    kind="manual",
)
def test_d_drive_has_the_commands_of_its_maker() -> None:
    """Setpoint, reading, status and actuator are set, mess, stat, acdescr."""
    for name, greeting, channels in (("ddrive", "DSM V", 6), ("30dv", "AP", 1)):
        profile = PSJ_PROFILES[name]  # type: ignore[index] # a name of the literal
        words = (profile.set, profile.read, profile.status, profile.serial)
        assert words == ("set", "mess", "stat", "acdescr")
        assert all(each.startswith(greeting) for each in profile.greetings)
        assert (profile.channels, profile.ending, profile.frames) == (channels, b"\r\n", True)
        # Bit 0: plugged in; 6: high voltage enabled; 7: closed loop; 9 to 11: generator.
        for status, flag in (
            (0x0040, DeviceFlag.SHORT_OR_OPEN),
            (0x0001, DeviceFlag.LOCAL_MODE),
            (0x00C1, DeviceFlag.LOCAL_MODE),
            (0x0241, DeviceFlag.LOCAL_MODE),
        ):
            assert flag in psj.flags_of(status, profile.status_bits)
        assert not psj.flags_of(0x0041, profile.status_bits)


@pytest.mark.confirms(
    "psj",
    "nv40",
    part="commands, bit rate, ends of lines, fault bits",
    by="psj-lib of piezosystem jena",
    kind="manual",
)
def test_nv40_has_the_commands_of_its_maker() -> None:
    """Setpoint and reading are set and rk at 19200 bit/s; ERROR has these bits."""
    profile = PSJ_PROFILES["nv40"]

    assert (profile.set, profile.read, profile.status) == ("set", "rk", "ERROR")
    assert (profile.baud, profile.ending, profile.channels) == (19_200, b"\r", 3)
    assert profile.limits == ("dspvmin", "dspvmax")
    for mask, flag in (
        (0x0001, DeviceFlag.SHORT_OR_OPEN),  # not plugged in
        (0x0002, DeviceFlag.SHORT_OR_OPEN),  # shorted
        (0x0010, DeviceFlag.DEVICE_FAILURE),  # EEPROM
        (0x1000, DeviceFlag.OVERLOAD),  # underload
        (0x2000, DeviceFlag.OVERLOAD),
        (0x4000, DeviceFlag.OTHER_DEVICE),  # invalid actuator
        (0x8000, DeviceFlag.OVER_TEMPERATURE),
    ):
        assert flag in psj.flags_of(mask, profile.status_bits)
    assert not psj.flags_of(0, profile.status_bits)


@pytest.mark.confirms(
    "psj",
    "nv40-1",
    part="commands, bit rate, ends of lines",
    by="Micro-Manager adapter Piezosystem_NV40_1, by the maker",
    kind="manual",
)
def test_nv40_1_has_the_commands_of_the_micro_manager_adapter() -> None:
    """A voltage is set by "wr,12.500" and CR, without a reply, and read by "rd"."""
    profile = PSJ_PROFILES["nv40-1"]

    assert psj.command(profile, profile.set, 0, 12.5) == b"wr,12.500\r"
    assert psj.command(profile, profile.read, 0) == b"rd\r"
    assert (profile.acknowledges, profile.frames, profile.baud) == (False, False, 9600)
    assert psj.line(b"rd,12.5\r\n") == len(b"rd,12.5\r\n")
