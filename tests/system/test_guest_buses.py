"""The drivers of CAN buses and serial ports at interfaces of a real kernel, that of a guest."""

from collections.abc import Iterator

import pytest

from tests.drivers.bus.bench import emulated
from tests.system.guest.kernel import fetch
from tests.system.guest.machine import Guest, booted, why_not

pytestmark = [
    pytest.mark.stress,
    pytest.mark.timeout(1800),  # the guest's processor is emulated
    pytest.mark.skipif(bool(why_not()), reason=why_not()),
]


@pytest.fixture(scope="module")
def guest(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[Guest]:
    """Return a guest, with an emulated amplifier at its USB adapter."""
    assert request.config.cache is not None
    try:
        kernel = fetch(request.config.cache.mkdir("guest"))
    except OSError as error:
        pytest.skip(f"no kernel for a guest: {error}")
    console = tmp_path_factory.mktemp("guest") / "console.log"
    with emulated("mdt694b") as amplifier:
        try:
            with booted(kernel, console, amplifier.where[0]) as guest:
                yield guest
        finally:
            print(console.read_text("utf-8", "replace"))


def test_can(guest: Guest) -> None:
    """The tests of `check_can.py` pass in the guest."""
    code, report = guest.check("check_can.py")
    print(report)
    assert code == 0


def test_usb_serial(guest: Guest) -> None:
    """The tests of `check_usb.py` pass in the guest."""
    code, report = guest.check("check_usb.py")
    print(report)
    assert code == 0
