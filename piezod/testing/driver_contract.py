"""The contract of `piezod.devices.interface`, as checks that any driver can be put through.

A check is a function that takes a factory, constructs its own devices with it, and raises
AssertionError where a device breaks the contract. To test a driver of your own::

    @pytest.mark.parametrize("check", checks_for(make_device), ids=lambda check: check.__name__)
    def test_driver_keeps_the_contract(check):
        check(make_device)

The factory constructs a device for the channels, the `Wiring`, that are to be checked. It need not
have both inputs and outputs: what is said of every input or output is said of those that there are.

The devices live on a made-up clock. An amplifier is driven to one volt above its rest voltage, or
one unit of its outputs where these are no volts, and to nothing else, so the checks may also be run
on a real one, and on an emulated one in another process: these are given two seconds until what was
written is in force.
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
    """List the checks that apply to the roles that the devices of this factory play.

    A role is played by whoever has its methods: `Sensor`, `Amplifier`, `Exchanges`, `TellsStatus`,
    `KnowsTruth`. Every device keeps the checks of `Device`. Listing them opens nothing.

    Args:
        factory: Constructs a new device at each call, without I/O.

    Raises:
        TypeError: If the devices are neither a `Sensor` nor an `Amplifier`.
    """
    device = factory()
    if not isinstance(device, Sensor | Amplifier):
        raise TypeError(f"{type(device).__name__} is neither a Sensor nor an Amplifier")
    checks = list(DEVICE_CHECKS)
    # The checks of a role take a factory of that role, which this factory has just shown to be.
    checks += cast("_Checks", SENSOR_CHECKS) if isinstance(device, Sensor) else ()
    checks += cast("_Checks", AMPLIFIER_CHECKS) if isinstance(device, Amplifier) else ()
    checks += cast("_Checks", EXCHANGE_CHECKS) if isinstance(device, Exchanges) else ()
    checks += cast("_Checks", STATUS_CHECKS) if isinstance(device, TellsStatus) else ()
    checks += cast("_Checks", TRUTH_CHECKS) if isinstance(device, KnowsTruth) else ()
    return checks
