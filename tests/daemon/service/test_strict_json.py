import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.daemon.service.answers import BadJsonError
from piezod.daemon.service.route import MAX_DEPTH, loads

WHOLE = st.integers(-(10**18) + 1, 10**18 - 1)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = st.recursive(
    st.none() | st.booleans() | WHOLE | FLOATS | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=10,
)
REFUSED = {
    "no JSON": b"{",
    "nothing": b"",
    "two": b"{} {}",
    "NaN": b'{"x": NaN}',
    "infinite": b'{"x": -Infinity}',
    "infinite in effect": b'{"x": 1e999}',
    "twice": b'{"x": 1, "x": 2}',
    "twice further in": b'{"a": [{"x": 1, "x": 2}]}',
    "deep": b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1),
    "very deep": b"[" * 200_000,
    "very deep objects": b'{"a":' * 40_000,
    "19 digits": b"1000000000000000000",
    "5000 digits": b"1" * 5000,
    "no UTF-8": b'"\xff"',
    "byte order mark": b"\xef\xbb\xbf{}",
    "half a pair": b'"\\ud800"',
    "half a pair in a key": b'{"\\ud800": 1}',
}


def _as_lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_lists(entry) for key, entry in value.items()}
    return [_as_lists(entry) for entry in value] if isinstance(value, tuple) else value


@given(VALUES)
def test_unambiguous_json_is_read(value: Any) -> None:
    """Every JSON document is read unchanged, except that lists become tuples."""
    assert _as_lists(loads(json.dumps(value).encode())) == value


def test_nesting_is_read_to_the_limit() -> None:
    """Sixteen levels are allowed."""
    text = b"[" * MAX_DEPTH + b"]" * MAX_DEPTH

    assert json.dumps(loads(text)).encode() == text


@pytest.mark.fault("C1")
@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
def test_ambiguous_json_is_refused(text: bytes) -> None:
    """Ambiguous JSON and numbers out of range are errors."""
    with pytest.raises(BadJsonError):
        loads(text)


@pytest.mark.fault("C1")
@given(st.binary(max_size=200))
def test_no_bytes_raise_anything_else(text: bytes) -> None:
    """Any bytes are read, or refused with BadJsonError."""
    try:
        loads(text)
    except BadJsonError as error:
        assert error.what


@pytest.mark.parametrize(
    ("text", "value"), [(b"190.0", 190), (b"-3e2", -300), (b"0.5", 0.5), (b"1e16", 1e16)]
)
def test_whole_numbers_may_be_written_with_a_point(text: bytes, value: float) -> None:
    """In JSON 190.0 is a whole number; one that a float may have rounded stays a float."""
    found = loads(text)

    assert (type(found), found) == (type(value), value)
