"""The list of the stages of a machine."""

import pytest

from piezod.client.listing import list_stages
from tests.client.fake_daemon import STATUS
from tests.client.group_of_fakes import Daemons


def test_running_stages_are_listed(daemons: Daemons) -> None:
    """Each has its status, and the holder of its lease."""
    lease = {"holder": {"user": "olga", "client": "scan"}, "expires_in_s": 9.0}
    processor = {"number": 3, "shared_with": 0}
    more = {"lease": lease, "rate_hz": 1000.0, "processor": processor}
    daemons["slow"].answers["GET status"] = {**STATUS, **more}

    fast, slow = list_stages()

    assert (fast.name, fast.lease_holder, fast.why) == ("fast", "", "")
    assert (slow.name, slow.lease_holder) == ("slow", "olga (scan)")
    assert slow.socket == daemons["slow"].socket_path
    assert slow.status is not None
    assert slow.status.processor is not None
    assert (slow.status.rate_hz, slow.status.processor.number) == (1000.0, 3)


def test_daemon_that_hangs_delays_no_other(daemons: Daemons) -> None:
    """It is listed with the reason; so is a requested stage that does not run."""
    daemons["fast"].answering.clear()

    fast, absent, slow = list_stages(["fast", "absent", "slow"], within_s=0.3)

    assert (fast.status, fast.socket) == (None, daemons["fast"].socket_path)
    assert "not answer" in fast.why
    assert (absent.status, absent.socket, absent.why) == (None, None, "no daemon is running")
    assert slow.status is not None


def test_error_of_a_daemon_is_the_reason(daemons: Daemons) -> None:
    """A daemon that refuses to report its status is listed with its words."""
    daemons["fast"].refuse("GET status", 403, "forbidden", "the user mallory has no role")

    fast, _ = list_stages()

    assert fast.why == "the user mallory has no role"


@pytest.mark.usefixtures("daemons")
def test_order_is_that_of_the_names() -> None:
    """Requested stages come in their own order, without names all come by name."""
    assert [each.name for each in list_stages(["slow", "fast"])] == ["slow", "fast"]
    assert [each.name for each in list_stages()] == ["fast", "slow"]
