"""Fixtures and settings for the tests of every room."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# No deadline: the first example may compile a kernel. In CI every run draws the same examples.
settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if "CI" in os.environ else "local")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder with reference vectors and recorded data, which no checkout contains.

    It is `PIEZOD_SHARED_DATA` where that is set, else the folder `shared` beside the checkout.
    """
    beside = Path(__file__).parents[2] / "shared"
    folder = Path(os.environ.get("PIEZOD_SHARED_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no test data: {folder} is not a folder (set PIEZOD_SHARED_DATA)")
    return folder
