import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.daemon.service.access import LEASE_S, LeaseKeeper
from piezod.daemon.service.answers import LeaseHeldError
from piezod.daemon.service.route import ROUTES
from piezod.daemon.stage.errors import NotNowError
from piezod.daemon.stage.peer import Peer
from piezod.messages.endpoints import Role
from tests.daemon.service.bodies import answer_of
from tests.daemon.service.fakes import FakeNow, Served

PEERS = [Peer(1000, 1, "ann", "", Role.OPERATOR), Peer(1000, 2, "ann", "b", Role.OPERATOR)]
PEERS.append(Peer(1001, 3, "bob", "", Role.OPERATOR))
NEEDS_LEASE = sorted(key for key, row in ROUTES.items() if row.access.lease)
NEEDS_NONE = sorted(ROUTES.keys() - set(NEEDS_LEASE))
STEPS = st.lists(
    st.tuples(st.sampled_from(["claim", "release", "wait"]), st.integers(0, 2), st.floats(0, 40))
)


@pytest.mark.fault("C8")
@given(STEPS)
def test_one_at_a_time_has_the_lease(steps: list[tuple[str, int, float]]) -> None:
    """No client gets the lease while another one has claimed it within 30 s."""
    now = FakeNow()
    lease = LeaseKeeper(now)
    holder, until_s = -1, 0.0

    for what, who, wait_s in steps:
        free = holder in (-1, who) or now.now_s >= until_s
        if what == "wait":
            now.now_s += wait_s
        elif what == "release":
            assert lease.release(PEERS[who]) == (holder == who)
            holder = -1 if holder == who else holder
        elif free:
            lease.claim(PEERS[who])
            holder, until_s = who, now.now_s + LEASE_S
        else:
            with pytest.raises(LeaseHeldError):
                lease.claim(PEERS[who])


@pytest.mark.fault("C8")
def test_command_of_another_is_refused_with_the_holder(served: Served) -> None:
    """The refusal has the holder of the lease and the remaining time."""
    with served.client("first") as first, served.client("second") as second:
        first.post("goto", json={"position_um": 1.0})
        served.now.now_s += 10.0
        answer = second.post("goto", json={"position_um": 2.0})

    assert answer.status_code == 409
    error = answer.json()["error"]
    assert (error["code"], error["expires_in_s"]) == ("lease_held", 20.0)
    assert error["holder"] == {"user": "somebody", "uid": served.stage.audited[0].peer.uid} | {
        "client": "first"
    }
    assert served.called() == 1


def test_status_shows_the_holder(served: Served) -> None:
    """The status shows who has the lease and for how long, until it has expired."""
    with served.client("first") as first, served.client("second") as second:
        first.post("lease").raise_for_status()
        served.now.now_s += 10.0
        held = second.get("status").json()["lease"]
        served.now.now_s += 20.0
        free = second.get("status").json()["lease"]

    assert (held["holder"]["client"], held["expires_in_s"], free) == ("first", 20.0, None)


@pytest.mark.fault("C8")
@pytest.mark.parametrize("endpoint", NEEDS_LEASE, ids=" ".join)
def test_endpoint_that_moves_needs_the_lease(served: Served, endpoint: tuple[str, str]) -> None:
    """The endpoint is refused while another client has the lease."""
    with served.client("first") as first, served.client("second") as second:
        first.post("lease").raise_for_status()
        answer = answer_of(second, endpoint)

    assert (answer.status_code, answer.json()["error"]["code"]) == (409, "lease_held")
    assert served.called() == 0


@pytest.mark.fault("C8")
def test_other_endpoints_need_none(served: Served) -> None:
    """Endpoints that look, or lead towards safety, need no lease."""
    with served.client("first") as first:
        first.post("lease").raise_for_status()
    for endpoint in NEEDS_NONE:
        served.now.now_s += 0.1  # the rate limit is another test's
        with served.client("second") as second:
            assert answer_of(second, endpoint).status_code in (200, 404), endpoint


@pytest.mark.fault("C9")
def test_lease_expires(served: Served) -> None:
    """After 30 s without a command another client gets the lease."""
    with served.client("first") as first, served.client("second") as second:
        first.post("lease").raise_for_status()
        served.now.now_s += LEASE_S
        answer = second.post("arm")

    assert answer.status_code == 200


def test_command_renews_the_lease(served: Served) -> None:
    """Each command renews the lease."""
    with served.client("first") as first, served.client("second") as second:
        first.post("arm")
        served.now.now_s += 20.0
        first.post("goto", json={"position_um": 1.0})
        served.now.now_s += 20.0
        answer = second.post("arm")

    assert answer.status_code == 409


def test_malformed_command_takes_no_lease(served: Served) -> None:
    """A malformed command does not take the lease."""
    with served.client("first") as first, served.client("second") as second:
        first.post("goto", json={})
        answer = second.post("arm")

    assert answer.status_code == 200


def test_lease_of_another_is_not_shortened() -> None:
    """A disconnect does not shorten the lease of another client."""
    now = FakeNow()
    lease = LeaseKeeper(now)
    lease.claim(PEERS[0])
    lease.shorten(PEERS[1], 2.0)
    now.now_s += 10.0

    with pytest.raises(LeaseHeldError):
        lease.claim(PEERS[1])


def test_lease_is_given_back(served: Served, client: httpx.Client) -> None:
    """After a release another client gets the lease at once."""
    lease = client.post("lease").json()
    released = [client.delete("lease").json()["released"] for _ in range(2)]

    assert lease["expires_in_s"] == LEASE_S
    assert lease["holder"]["client"] == "test"
    assert released == [True, False]
    with served.client("second") as second:
        assert second.post("arm").status_code == 200


@pytest.mark.fault("C8")
def test_refused_request_takes_no_lease(served: Served) -> None:
    """Another client may command after a refusal; a holder keeps the lease in spite of one."""
    with served.client("first") as first, served.client("second") as second:
        served.stage.refusal = "not now"
        assert first.post("arm").status_code == 409
        assert first.post("stream", content=b'{"x": 1.0}\n').status_code == 409
        served.stage.refusal = ""
        assert second.post("arm").status_code == 200
        served.stage.refusal = "not now"
        assert second.post("arm").status_code == 409
        served.stage.refusal = ""

        assert first.post("arm").json()["error"]["code"] == "lease_held"


@pytest.mark.fault("C8")
def test_request_without_an_answer_keeps_the_lease(served: Served) -> None:
    """The loop may have carried it out."""
    with served.client("first") as first, served.client("second") as second:
        served.stage.lost_link = True
        assert first.post("arm").status_code == 503
        served.stage.lost_link = False

        assert second.post("arm").json()["error"]["code"] == "lease_held"


def test_refusal_takes_no_lease_that_another_request_renewed() -> None:
    """Of two requests of one client at the same time only one may be refused."""
    lease = LeaseKeeper(FakeNow())
    with pytest.raises(NotNowError), lease.claimed(PEERS[0]):
        lease.claim(PEERS[0])
        raise NotNowError("not now")

    with pytest.raises(LeaseHeldError):
        lease.check(PEERS[2])
