"""The CAN drivers with emulated nodes in another process, behind an slcan adapter."""

from pathlib import Path

import pytest

from piezod.testing.device_checks import DEVICE_CHECKS
from piezod.testing.driver_contract import checks_for
from tests.drivers.bus import checks
from tests.drivers.bus.bench import emulated
from tests.drivers.bus.checks import Row, Session
from tests.drivers.bus.profiles import Profile
from tests.drivers.can_bus.profiles import CANOPEN, CANOPEN_PDO, POLLED, REPORTED

ALL = (
    Row(checks.pulled_in_every_call, ("B1",)),
    Row(checks.pulled_while_opening),
    Row(checks.nobody_is_there),
    Row(checks.lost_replies, ("B5",)),
    Row(checks.noise, ("B3",)),
    Row(checks.garbled_replies),
    Row(checks.duplicated_replies, ("B6",)),
    Row(checks.another_path, ("B2",)),
    Row(checks.shared_port, ("B14",)),
)
ANSWERED = (
    Row(checks.reads_back_what_it_wrote, ("A3", "A12")),
    Row(checks.unacknowledged_writes, ("A1",)),
    Row(checks.late_replies, ("B5",)),
    Row(checks.slow_replies, ("B7",)),
)
CHECKED = (Row(checks.flipped_bits, ("B4",)),)
NAMED = (Row(checks.another_device, ("S10",)),)  # last, because the other device then stays

CASES = (
    ("canopen", CANOPEN, (*ALL, *ANSWERED, *NAMED)),
    ("canopen-pdo", CANOPEN_PDO, (*ALL, *ANSWERED)),
    ("dbc-polled", POLLED, (*ALL, *ANSWERED, *CHECKED)),
    ("dbc-reported", REPORTED, (*ALL, *CHECKED)),
)


def _case(name: str, profile: Profile, rows: tuple[Row, ...]) -> object:
    ids = sorted({each for row in rows for each in row.ids})
    marks = [pytest.mark.sees(profile.driver, each) for each in ids]
    marks += [pytest.mark.stress] if profile.takes_long else []
    return pytest.param(profile, rows, marks=marks, id=name)


@pytest.mark.parametrize(("profile", "rows"), [_case(*case) for case in CASES])
def test_driver_masters_what_goes_wrong(
    tmp_path: Path, profile: Profile, rows: tuple[Row, ...], subtests: pytest.Subtests
) -> None:
    """Each driver keeps the driver contract and detects each fault that it claims to detect."""
    with emulated(f"{profile.name}={tmp_path / 'can.tty'}") as device:
        factory = profile.maker(device.where[0])
        # The read-back of a report has the age of the last report, not of the contract's clock.
        for check in checks_for(factory) if profile is not REPORTED else DEVICE_CHECKS:
            with subtests.test(check.__name__):
                check(factory)
        session = Session(profile, device)
        for row in rows:
            with subtests.test(row.check.__name__):
                row.check(session)
