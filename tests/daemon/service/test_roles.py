import asyncio
import grp
import os
import pwd
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from fastapi.routing import APIRoute

from piezod.daemon.service.access import GroupRoles
from piezod.daemon.service.connection import Credentials
from piezod.daemon.service.route import ROUTES
from piezod.daemon.service.routes import router
from piezod.messages.endpoints import Role
from tests.daemon.service.bodies import answer_of
from tests.daemon.service.fakes import FakeNow, Served

STRANGER = Credentials(1, 54321, 54321)
ENDPOINTS = sorted(ROUTES)


def test_every_route_is_in_the_table() -> None:
    """The application has the endpoints of the table of commands, and no others."""
    found = {
        (method, route.path)
        for route in router.routes
        if isinstance(route, APIRoute)
        for method in route.methods or ()
    }

    assert found == ROUTES.keys()


@pytest.mark.fault("C6")
@pytest.mark.parametrize("role", list(Role))
def test_every_endpoint_asks_for_its_role(served: Served, role: Role) -> None:
    """A role below that of the endpoint gets 403, all other roles do not."""
    served.roles.role = role
    refused = set()
    for endpoint in ENDPOINTS:
        served.now.now_s += 0.1  # the rate limit is another test's
        with served.client() as client:
            answer = answer_of(client, endpoint)
        assert answer.status_code in (200, 403, 404), (endpoint, answer.text)
        if answer.status_code == 403:
            refused.add(endpoint)

    assert refused == {endpoint for endpoint, row in ROUTES.items() if row.access.role > role}


@pytest.mark.fault("C6")
def test_refused_user_reaches_nothing(served: Served, client: httpx.Client) -> None:
    """The request of a viewer is not carried out, and the audit has it."""
    served.roles.role = Role.VIEWER
    answer = client.post("arm")

    assert answer.json()["error"]["what"] == "somebody has the role viewer, this needs operator"
    assert served.called() == 0
    assert [(entry.what, entry.accepted) for entry in served.stage.audited] == [
        ("POST /v1/arm", False)
    ]


@pytest.mark.fault("C6")
def test_role_comes_before_body(served: Served, client: httpx.Client) -> None:
    """The role is checked before the body."""
    served.roles.role = Role.VIEWER

    assert client.post("goto", content=b"{").status_code == 403


def test_user_comes_from_the_kernel(served: Served, client: httpx.Client) -> None:
    """User and process come from the kernel."""
    client.post("hold")

    peer = served.stage.audited[0].peer
    assert (peer.uid, peer.pid) == (os.getuid(), os.getpid())


def test_name_of_a_client_is_checked(served: Served) -> None:
    """A client name with a character that is not allowed is refused."""
    with served.client("a b") as client:
        assert client.post("hold").status_code == 400


@pytest.fixture
def members(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, list[int]]]:
    """Return the groups of each user; the groups with a role are 801 and 802."""
    groups: dict[str, list[int]] = {"someone": []}
    numbers = {"piezod": 801, "piezod-eng": 802}

    def group(name: str) -> Any:
        return grp.struct_group((name, "x", numbers[name], []))

    def user(uid: int) -> Any:
        if uid != STRANGER.uid:
            raise KeyError(uid)
        return pwd.struct_passwd(("someone", "x", uid, uid, "", "/", "/bin/sh"))

    def group_list(name: str, gid: int) -> list[int]:
        return [gid, *groups[name]]

    monkeypatch.setattr(grp, "getgrnam", group)
    monkeypatch.setattr(pwd, "getpwuid", user)
    monkeypatch.setattr(os, "getgrouplist", group_list)
    yield groups


def _role(roles: GroupRoles, credentials: Credentials) -> Role:
    return asyncio.run(roles.user(credentials)).role


@pytest.mark.fault("C6")
@pytest.mark.parametrize(
    ("groups", "role"),
    [
        ([], Role.VIEWER),
        ([801], Role.OPERATOR),
        ([802], Role.ENGINEER),
        ([802, 801], Role.ENGINEER),
        ([800], Role.VIEWER),
    ],
)
def test_role_is_that_of_the_best_group(
    members: dict[str, list[int]], groups: list[int], role: Role
) -> None:
    """A user has the largest role of all groups."""
    members["someone"] = groups

    assert _role(GroupRoles(1000, FakeNow()), STRANGER) == role


@pytest.mark.fault("C6")
@pytest.mark.parametrize("uid", [0, 1000])
def test_root_and_the_daemons_user_are_engineers(members: dict[str, list[int]], uid: int) -> None:
    """Root and the user of the daemon are engineers, also without a user entry."""
    assert members
    assert _role(GroupRoles(1000, FakeNow()), Credentials(1, uid, uid)) == Role.ENGINEER


def test_primary_group_counts_without_an_entry(members: dict[str, list[int]]) -> None:
    """The primary group of a user without a name counts."""
    assert members
    roles = GroupRoles(1000, FakeNow())

    assert asyncio.run(roles.user(Credentials(1, 4711, 801))) == ("4711", Role.OPERATOR)


def test_change_of_groups_takes_effect(members: dict[str, list[int]]) -> None:
    """A user who leaves a group loses its role within 30 s."""
    now = FakeNow()
    roles = GroupRoles(1000, now)
    members["someone"] = [801]
    before = _role(roles, STRANGER)
    members["someone"] = []
    now.now_s += 30.0

    assert (before, _role(roles, STRANGER)) == (Role.OPERATOR, Role.VIEWER)


def test_user_is_looked_up_once(members: dict[str, list[int]]) -> None:
    """The role of a user is looked up once in 30 s."""
    roles = GroupRoles(1000, FakeNow())
    before = _role(roles, STRANGER)
    members["someone"] = [801]

    assert (before, _role(roles, STRANGER)) == (Role.VIEWER, Role.VIEWER)


def test_groups_need_not_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the groups every other user is a viewer."""

    def none(name: str) -> Any:
        raise KeyError(name)

    monkeypatch.setattr(grp, "getgrnam", none)

    assert _role(GroupRoles(1000, FakeNow()), STRANGER) == Role.VIEWER
