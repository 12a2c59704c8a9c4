"""Drivers without a device on the other end keep the driver contract, with default options."""

from collections.abc import Callable
from functools import partial

import pytest

from piezod.devices import registry
from piezod.devices.interface import Device, Wiring
from piezod.testing.check_support import opened
from piezod.testing.driver_contract import checks_for

# The contract of all other drivers is checked in tests/drivers, against an emulator.
DRIVERS = ["simulated"]


def factory_of(driver: str, axes: tuple[str, ...]) -> Callable[[], Device]:
    """Return a function that constructs devices of this driver with default options."""
    plugin = registry.load(driver)
    return partial(plugin.create, plugin.options_model(), Wiring.both(axes), 1)


# The driver is loaded inside the tests, so that a broken one fails only here.
@pytest.mark.parametrize("axes", [("x",), ("x", "y")])
@pytest.mark.parametrize("driver", DRIVERS)
def test_driver_keeps_the_contract(
    driver: str, axes: tuple[str, ...], subtests: pytest.Subtests
) -> None:
    """The driver passes every check of its roles."""
    factory = factory_of(driver, axes)
    for check in checks_for(factory):
        with subtests.test(check.__name__):
            check(factory)


@pytest.mark.parametrize("driver", DRIVERS)
def test_driver_serves_the_channels_it_was_given(driver: str) -> None:
    """Capabilities list the requested channels in that order."""
    with opened(factory_of(driver, ("y", "x"))) as device:
        able = device.capabilities()

    assert (able.inputs, able.outputs) == (("y", "x"), ("y", "x"))
