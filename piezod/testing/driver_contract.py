"""The contract of `piezod.devices.interface`, as checks for any driver.

A check is a function that takes a factory, constructs its own devices with it, and raises
AssertionError if a device breaks the contract. To test your own driver::

    @pytest.mark.parametrize("check", checks_for(make_device), ids=lambda check: check.__name__)
    def test_driver_keeps_the_contract(check):
        check(make_device)

The factory constructs a device for the channels (the `Wiring`) to be checked. A device may lack
inputs or outputs; the checks then cover the channels that it has.

The devices run on a simulated clock. An amplifier is driven only to one volt above its rest
voltage, or one unit of its outputs if the unit is not V. The checks may therefore also run on a
real device, and on an emulated device in another process: these get two seconds until a written
value must be in force.
"""

from typing import TypeAlias, cast

from piezod.devices.interface import Amplifier, Exchanges, KnowsTruth, Sensor
from piezod.devices.status import TellsStatus
from piezod.testing.amplifier_checks import AMPLIFIER_CHECKS
from piezod.testing.check_support import Check, DeviceFactory
from piezod.testing.device_checks import DEVICE_CHECKS
from piezod.testing.exchange_checks import EXCHANGE_CHECKS
from piezod.testing.sensor_checks import SENSOR_CHECKS
from piezod.testing.status_checks import STATUS_CHECKS
from piezod.testing.truth_checks import TRUTH_CHECKS

_Checks: TypeAlias = tuple[Check, ...]


def checks_for(factory: DeviceFactory) -> list[Check]:
    """Return the checks for the roles of the devices of this factory.

    A device has a role if it has its methods: `Sensor`, `Amplifier`, `Exchanges`, `TellsStatus`,
    `KnowsTruth`. The checks of `Device` apply to all. Listing the checks opens nothing.

    Args:
        factory: Constructs a new device at each call, without I/O.

    Raises:
        TypeError: If the devices are neither a `Sensor` nor an `Amplifier`.
    """
    device = factory()
    if not isinstance(device, Sensor | Amplifier):
        raise TypeError(f"{type(device).__name__} is neither a Sensor nor an Amplifier")
    checks = list(DEVICE_CHECKS)
    # The checks of a role take a factory of that role; isinstance has just shown that it is one.
    checks += cast("_Checks", SENSOR_CHECKS) if isinstance(device, Sensor) else ()
    checks += cast("_Checks", AMPLIFIER_CHECKS) if isinstance(device, Amplifier) else ()
    checks += cast("_Checks", EXCHANGE_CHECKS) if isinstance(device, Exchanges) else ()
    checks += cast("_Checks", STATUS_CHECKS) if isinstance(device, TellsStatus) else ()
    checks += cast("_Checks", TRUTH_CHECKS) if isinstance(device, KnowsTruth) else ()
    return checks
