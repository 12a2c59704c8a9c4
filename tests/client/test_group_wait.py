"""What becomes of a movement of several stages until all of them have arrived."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import pytest

from piezod.client import StageGroup, mover
from piezod.client.stage_group import GroupStart
from piezod.errors import GroupError, RefusedError
from tests.client.fake_daemon import ACCEPTED, Document, FakeDaemon, interval
from tests.client.group_of_fakes import Daemons, asked
from tests.daemon.waiting import eventually, join

MOVING, THERE = interval(), interval(12.5, on_target=True)
AXIS = {"limits": {"drive_min_v": 0.0, "drive_max_v": 150.0}, "sensor": {}}
TARGETS = {"fast": {"x": 12.5}, "slow": {"x": 12.5}}
SWING = {"kind": "sine", "low": 0.0, "high": 5.0, "frequency_hz": 1.0}


def moving(daemons: Daemons, **telemetry: list[Document]) -> GroupStart:
    """Start a movement of all stages; each plays its intervals, the last one for ever."""
    for name, daemon in daemons.items():
        daemon.answers["GET config"] = {"axes": {"x": AXIS}}
        daemon.telemetry, daemon.lasting = telemetry.get(name, [MOVING]), True
    with StageGroup("raster") as group:
        started = group.goto(TARGETS)
    for daemon in daemons.values():
        daemon.asked.clear()
    return started


def failing(started: GroupStart, **arguments: Any) -> GroupError:
    """Wait for a movement that fails; return the error."""
    with StageGroup("raster") as group, pytest.raises(GroupError) as caught:
        group.wait(started, **arguments)
    return caught.value


def held(daemons: Daemons) -> list[str]:
    """Return the stages that were told to hold."""
    return [name for name, daemon in daemons.items() if "POST hold" in asked(daemon)]


def test_the_wait_ends_when_the_last_stage_has_arrived(daemons: Daemons) -> None:
    """Each axis has its arrival then, and nobody holds; a loop of asyncio may run meanwhile."""
    started = moving(daemons, fast=[THERE], slow=[*[MOVING] * 5, THERE])

    async def wait() -> list[float]:
        with StageGroup("raster") as group:
            return [one.position_um for each in group.wait(started).values() for one in each]

    assert asyncio.run(wait()) == [12.5, 12.5]
    assert held(daemons) == []


@pytest.mark.parametrize(
    ("last", "why"),
    [
        (interval(state="FAULT", faults=("S5",)), "the stage went to FAULT because of S5"),
        (interval(state="HOLD"), "the stage went to HOLD"),
        (interval(motion=8), "another movement has replaced this one"),
    ],
)
@pytest.mark.parametrize("before", [MOVING, THERE])
def test_a_stage_that_leaves_the_movement_ends_it(
    daemons: Daemons, before: Document, last: Document, why: str
) -> None:
    """The other stage holds, and this one stays as it is; so after it has arrived before others."""
    error = failing(moving(daemons, slow=[before] * 3 + [last]))

    assert f"slow: axis x: {why}" in str(error)
    assert "(fast held)" in str(error)
    assert held(daemons) == ["fast"]


def test_a_stage_that_is_lost_ends_the_movement(daemons: Daemons) -> None:
    """It is told to hold too, because nobody knows whether it still moves."""
    started = moving(daemons)
    daemons["slow"].lasting = False

    assert set(failing(started).failed) == {"slow"}
    assert held(daemons) == ["fast", "slow"]


def is_watched(daemon: FakeDaemon) -> bool:
    """Return whether somebody has asked for its telemetry."""
    return any("telemetry" in each.what for each in daemon.asked)


def while_waiting(daemons: Daemons, started: GroupStart, act: Callable[[], None]) -> GroupError:
    """Act as soon as all stages are watched; return the error of the wait."""
    caught: list[GroupError] = []
    thread = threading.Thread(target=lambda: caught.append(failing(started)))
    thread.start()
    eventually(lambda: all(map(is_watched, daemons.values())))
    act()
    join(thread)
    return caught[0]


def test_a_lease_that_another_client_has_now_ends_the_movement(
    daemons: Daemons, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stage is left to that client, and the others hold."""
    monkeypatch.setattr(mover, "RENEW_EACH_S", 0.01)

    def lose() -> None:
        daemons["slow"].refuse("POST lease", 409, "lease_held", "olga holds the lease")

    assert "slow: olga holds the lease" in str(while_waiting(daemons, moving(daemons), lose))
    assert held(daemons) == ["fast"]


def test_a_wait_that_is_over_stops_nobody(daemons: Daemons) -> None:
    """After the time-out of the caller all stages continue."""
    error = failing(moving(daemons, fast=[THERE]), timeout_s=0.05)

    assert error.code == "timeout"
    assert held(daemons) == []


def test_a_stage_that_refuses_moves_no_other(daemons: Daemons) -> None:
    """The stages that have begun hold."""
    daemons["slow"].refuse("POST wave", 409, "refused", "out of range")

    with StageGroup("raster") as group, pytest.raises(GroupError, match="goto failed on slow"):
        group.goto_and_wait(TARGETS)

    assert held(daemons) == ["fast"]


def test_waveforms_are_done_without_an_arrival(daemons: Daemons) -> None:
    """A mode that leaves an error ends a waveform too, and a time-out does not; nor do tables."""
    for daemon in daemons.values():
        daemon.answers["POST wave"] = {**ACCEPTED, "duration_s": -1.0}
    moving(daemons)

    with StageGroup("raster") as group:
        arrived = group.wait(group.wave({"fast": {"x": SWING}, "slow": {"x": SWING}}, 2.0))
        for daemon in daemons.values():
            daemon.answers["POST wave"] = {**ACCEPTED, "duration_s": 3600.0}
        follows = group.wave({"fast": {"x": SWING}}, 2.0)
        with pytest.raises(GroupError, match="not on target within"):
            group.wait(follows, timeout_s=0.05)
        with pytest.raises(RefusedError, match="a table arrives nowhere"):
            group.wait(GroupStart(start_s=0.0, answers={}))

    assert [each[0].position_um for each in arrived.values()] == [12.4, 12.4]
