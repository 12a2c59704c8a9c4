"""Plain scalars follow the core schema of YAML 1.2."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.scalars import resolve


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("~", None),
        ("null", None),
        ("NULL", None),
        ("true", True),
        ("False", False),
        ("0", 0),
        ("-12", -12),
        ("+7", 7),
        ("010", 10),
        ("0o17", 15),
        ("0x1F", 31),
        ("9223372036854775807", 2**63 - 1),
        ("1e3", 1000.0),
        ("1E-2", 0.01),
        ("-2.5e+3", -2500.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.5", -0.5),
        (".inf", math.inf),
        ("-.Inf", -math.inf),
        ("1e999", math.inf),
    ],
)
def test_words_of_the_core_schema(text: str, value: object) -> None:
    """Null, booleans and numbers follow YAML 1.2, with their type."""
    found = resolve(text)

    assert value == found
    assert type(value) is type(found)


@pytest.mark.parametrize(
    "text",
    ["yes", "No", "on", "OFF", "y", "nULL", "tRUE", "10:30", "1:30:00", "2024-01-02", "1_000",
     "0b11", "-0x1", "0o8", "0xG", "1e", "e3", ".", "+", "1.2.3", "inf", "nan", ".inff", "٣"],
)  # fmt: skip
def test_everything_else_is_text(text: str) -> None:
    """Words with a meaning in YAML 1.1 or Python only stay texts."""
    assert text == resolve(text)


def test_nan() -> None:
    """`.nan` is read; the schema refuses it."""
    found = resolve(".NaN")

    assert isinstance(found, float)
    assert math.isnan(found)


@pytest.mark.parametrize(
    "text", ["9223372036854775808", "-9223372036854775809", "0xFFFFFFFFFFFFFFFF"]
)
def test_whole_numbers_beyond_64_bits(text: str) -> None:
    """A whole number beyond 64 bits is refused."""
    with pytest.raises(ValueError, match="beyond 64 bits"):
        resolve(text)


@pytest.mark.parametrize("text", ["1" * 101, "0x" + "1" * 99, "0." + "1" * 99])
def test_absurdly_long_numbers(text: str) -> None:
    """Very long numbers are not converted, because that could take long."""
    with pytest.raises(ValueError, match="more than 100 characters"):
        resolve(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_round_trip(number: float) -> None:
    """Every finite double that Python writes is read as the same double."""
    found = resolve(repr(number))

    assert number == found
    assert isinstance(found, float)


@given(st.integers(-(2**63), 2**63 - 1))
def test_integers_round_trip(number: int) -> None:
    """Every 64-bit integer is read as itself, decimal, octal and hexadecimal."""
    assert number == resolve(str(number))
    assert abs(number) == (resolve(hex(abs(number))) if number != -(2**63) else 2**63)
