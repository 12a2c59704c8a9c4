"""The stream of Micro-Epsilon sensors as bytes, and the emulated sensors."""

from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod_drivers.serial_line.micro_epsilon import codec
from piezod_drivers.serial_line.micro_epsilon.emulator import SensorEmulator, word_of
from piezod_drivers.serial_line.micro_epsilon.identity import parse_identity
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES
from tests.drivers.serial_line.linear_rig import bench


@pytest.mark.parametrize(
    ("model", "count", "position_um"),
    [
        ("ILD1420", 32_760, 5_000.0),
        ("ILD1900", 98_232, 0.0),
        ("ILD1750", 98_232 + 65_536, 10_000.0),
        ("ODC2520", 131_026, 26.0),
        ("ILD1402", 8_184, 5_000.0),
    ],
)
def test_scales(model: str, count: int, position_um: float) -> None:
    """Counts agree with the formulas of the manuals, for a range of 10 mm."""
    assert PROFILES[model].read(count, 10_000.0)[0] == pytest.approx(position_um, abs=1e-6)
    assert PROFILES[model].count_at(position_um, 10_000.0) == count


@given(
    st.sampled_from(sorted(PROFILES)),
    st.floats(-1e5, 1e5) | st.just(nan),
)
def test_any_count_is_read_within_range_or_refused(model: str, number: float) -> None:
    """Any count gives a displacement within 1.5 ranges, or NaN."""
    profile = PROFILES[model]
    count = 0 if isnan(number) else int(abs(number)) % (1 << 18 if profile.word_bytes == 3 else 14)
    position_um, flags = profile.read(count, 10_000.0)
    if not isnan(position_um):
        assert not flags
        assert -131_000 <= position_um <= 131_072


@given(st.binary(max_size=400), st.sampled_from([2, 3]))
def test_arbitrary_bytes_are_a_stream(garbage: bytes, word_bytes: int) -> None:
    """Any bytes are read without error, and less than a word is kept."""
    value, rest, _ = codec.newest(garbage, word_bytes)
    assert len(rest) < word_bytes
    assert value is None or 0 <= value < 1 << 6 * word_bytes + (2 if word_bytes == 2 else 0)
    parse_identity(codec.text_of(garbage, word_bytes))


@given(
    st.lists(st.integers(0, 262_143), min_size=1, max_size=60),
    st.lists(st.integers(1, 40), min_size=1, max_size=60),
)
def test_parts_of_a_stream_give_what_the_whole_gives(counts: list[int], cuts: list[int]) -> None:
    """However a stream is split, its last value is found and no word is broken."""
    whole, place, rest = b"".join(word_of(count, 3) for count in counts), 0, b""
    last = None
    for cut in cuts * len(whole):
        part = whole[place : place + cut]
        place += cut
        value, rest, broken = codec.newest(rest + part, 3)
        assert not broken
        last = last if value is None else value
        if place >= len(whole):
            break
    assert last == counts[-1]


def test_additional_values_are_passed_over() -> None:
    """Additional values are not taken for the distance."""
    both = word_of(5, 3) + word_of(9, 3, additional=True)
    assert codec.newest(both * 3, 3) == (5, b"", False)


def test_unknown_command_is_refused() -> None:
    """An emulated sensor answers an unknown command with an error and a prompt."""
    stand, _, _ = bench()
    sensor = SensorEmulator(stand, "", "ILD1420", "ILD1420-10", 10.0, 5000.0)
    assert sensor.receive(b"HE") == []
    assert sensor.receive(b"LP\r\n") == [b"HELP\r\nE200 I/O error\r\n->"]
    assert len(sensor.due()) == 1
    assert sensor.due() == []


@pytest.mark.parametrize("text", ["", "Name: ILD1420", "Name: ILD1420\r\n->", "Serial: 1\r\n->"])
def test_half_an_answer_gives_no_identity(text: str) -> None:
    """An identity is complete with name, serial number and prompt."""
    assert parse_identity(text) is None
