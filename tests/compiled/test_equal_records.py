"""Compiled and interpreted modules compute the same records, to the bit."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Final, cast

import pytest

ROOT: Final = Path(__file__).parents[2]
COMPILED: Final = ROOT / "build" / "compiled"


def digests(first_on_path: Path, cycles: int) -> dict[str, str]:
    """Return the digest of each scene, from the modules that are found first in a folder."""
    process = subprocess.run(
        [sys.executable, "-P", "-m", "tests.compiled.drama", str(cycles)],
        env={**os.environ, "PYTHONPATH": str(first_on_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    return cast("dict[str, str]", json.loads(process.stdout))


@pytest.mark.skipif(not COMPILED.exists(), reason="`make compiled` has made no compiled build")
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "cycles", [500, pytest.param(10_000, marks=pytest.mark.stress)], ids=["short", "long"]
)
def test_records_are_equal_to_the_bit(cycles: int) -> None:
    """In all modes, with each class of model, and with faults of each kind."""
    assert digests(COMPILED, cycles) == digests(ROOT, cycles)


def test_a_drama_repeats_itself() -> None:
    """Two runs of one build have the same digests, so that a difference tells something."""
    assert digests(ROOT, 50) == digests(ROOT, 50)
