"""The driver `emulated` keeps the driver contract."""

from functools import partial
from pathlib import Path

import pytest

from piezod.testing.driver_contract import checks_for
from tests.drivers.emulated_bench import driver_of, serving


@pytest.mark.parametrize("axes", [("x",), ("x", "y")])
def test_driver_keeps_the_contract(
    tmp_path: Path, axes: tuple[str, ...], subtests: pytest.Subtests
) -> None:
    """The driver passes every check of its roles."""
    path = tmp_path / "rig.sock"
    factory = partial(driver_of, path, axes)
    with serving(path, axes):
        for check in checks_for(factory):
            with subtests.test(check.__name__):
                check(factory)
