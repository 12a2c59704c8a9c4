"""Every device that can be emulated at a pty or a TCP port, in another process, and its driver."""

from collections.abc import Callable
from typing import Any

import pytest

from piezod.testing.amplifier_checks import AMPLIFIER_CHECKS
from piezod.testing.driver_contract import checks_for
from piezod.testing.sensor_checks import SENSOR_CHECKS
from tests.drivers.bus.bench import emulated
from tests.drivers.bus.checks import Session, checks_of
from tests.drivers.bus.profiles import PROFILES, Profile


def _row(profile: Profile) -> object:
    """Return a profile with the marks of the faults that its driver detects."""
    ids = {each for row in checks_of(profile) for each in row.ids}
    marks = [pytest.mark.sees(profile.driver, each) for each in sorted(ids)]
    marks += [pytest.mark.stress] if profile.takes_long else []
    return pytest.param(profile, marks=marks, id=profile.name)


def _contract(profile: Profile, factory: Callable[[], Any]) -> list[Any]:
    """Return the checks of the roles of a device with its wiring."""
    checks: list[Any] = checks_for(factory)
    inputs, outputs = profile.wiring
    others = {*(() if inputs else SENSOR_CHECKS), *(() if outputs else AMPLIFIER_CHECKS)}
    return [check for check in checks if check not in others]


@pytest.mark.parametrize("profile", [_row(profile) for profile in PROFILES])
@pytest.mark.few(6)
def test_driver_masters_what_goes_wrong(
    profile: Profile, subtests: pytest.Subtests, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each driver keeps the driver contract and detects each fault that it claims to detect.

    One process serves the device for all checks, because starting it takes longer than they do.
    """
    for constant, wait_ns in profile.shorter.items():
        monkeypatch.setattr(constant, wait_ns)
    with emulated(profile.name, arguments=profile.arguments) as device:
        factory = profile.maker(device.where[0])
        for check in _contract(profile, factory):
            with subtests.test(check.__name__):
                check(factory)
        session = Session(profile, device)
        for row in checks_of(profile):
            with subtests.test(row.check.__name__):
                row.check(session)
