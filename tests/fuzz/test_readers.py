"""Damaged files and bodies are accepted or refused, as documented; `make fuzz` damages more."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.readers import READERS, Reader

# HDF5 loops for ever on some damaged files: a process looks through each one, which takes 0.2 s.
pytestmark = pytest.mark.usefixtures("looks_elsewhere")
HDF5 = ("recording", "result", "foreign")
WORDS = st.sampled_from(
    [b"", b"-", b"[", b'{"', b"nan", b"1e999", b"\n", b": ", b"9" * 400, b"\xff", b"\\ud800", b"\0"]
)
DAMAGE = st.lists(
    st.tuples(
        st.floats(0.0, 1.0), st.sampled_from([0, 0, 1, 8, 10**6]), WORDS | st.binary(max_size=4)
    ),
    min_size=1,
    max_size=4,
)


def damaged(content: bytes, damage: list[tuple[float, int, bytes]]) -> bytes:
    """Return bytes with some replaced; each damage has its place, how many are cut, and others."""
    for place, cut, put in damage:
        at = int(place * len(content))
        content = content[:at] + put + content[at + cut :]
    return content


@cache
def reader(name: str) -> Reader:
    """Return a reader, which is made once."""
    return READERS[name]()


@pytest.mark.parametrize("name", READERS)
def test_good_example_is_accepted(name: str, tmp_path: Path) -> None:
    """Otherwise only refusals would be tested."""
    assert reader(name).survives(reader(name).good, tmp_path / "good")


@pytest.mark.parametrize("name", READERS)
@pytest.mark.few(8)
def test_damaged_input_is_accepted_or_refused(name: str, tmp_path: Path) -> None:
    """No other exception than the documented ones."""
    path = tmp_path / "damaged"
    examples = settings().max_examples // (4 if name in HDF5 else 1)

    @settings(max_examples=examples, suppress_health_check=list(HealthCheck))
    @given(damage=DAMAGE)
    def check(damage: list[tuple[float, int, bytes]]) -> None:
        reader(name).survives(damaged(reader(name).good, damage), path)

    check()


@pytest.mark.parametrize("name", ["recording", "result"])
@pytest.mark.parametrize("spoil", [lambda index: index + 5, lambda index: index + 30])
def test_damaged_index_of_a_finished_file_is_refused(
    name: str, spoil: Callable[[int], int], tmp_path: Path
) -> None:
    """HDF5 is not asked to wait for a writer, which would take hours."""
    content = bytearray(reader(name).good)
    for signature in (b"EAHD", b"OHDR"):
        start = content.find(signature, reader(name).kept)
        if start >= 0:
            content[spoil(start)] ^= 0xFF

    assert not reader(name).survives(bytes(content), tmp_path / "damaged.h5")
