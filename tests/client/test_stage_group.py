"""A group of stages, as a whole or not at all."""

import time
from pathlib import Path

import pytest

from piezod.client import StageGroup, group_requests
from piezod.errors import ConfigError, GroupError, NotRunningError, RefusedError
from tests.client.fake_daemon import STATUS
from tests.client.group_of_fakes import Daemons, asked

SWING = {"kind": "sine", "low": 0.0, "high": 5.0, "frequency_hz": 1.0}


def test_all_stages_are_armed(daemons: Daemons) -> None:
    """Each stage gives its lease before the first one is armed."""
    with StageGroup("raster", name="scan") as group:
        answers = group.arm(shadow=True)

    assert list(answers) == ["fast", "slow"]
    for daemon in daemons.values():
        assert asked(daemon) == ["POST lease", "POST arm"]
        assert daemon.asked[-1].body == {"shadow": True, "confirm_output": False}
        assert daemon.asked[-1].client == "scan"


def test_arm_that_one_stage_refuses_is_taken_back(daemons: Daemons) -> None:
    """The others are disarmed, their leases are free again, and the text says who refused."""
    daemons["slow"].refuse("POST arm", 409, "refused", "in FAULT because of S5", "`piezod reset`")

    with StageGroup("raster") as group, pytest.raises(GroupError) as caught:
        group.arm()

    assert str(caught.value) == (
        "group raster: arm failed on slow: in FAULT because of S5 (taken back: fast disarmed); "
        "`piezod reset`"
    )
    assert list(caught.value.failed) == ["slow"]
    assert asked(daemons["fast"]) == ["POST lease", "POST arm", "POST disarm", "DELETE lease"]
    assert asked(daemons["slow"]) == ["POST lease", "POST arm", "DELETE lease"]


def test_stage_that_was_armed_before_stays_armed(daemons: Daemons) -> None:
    """Only what the request itself has done is taken back; a lease of before is kept."""
    lease = {"holder": {"user": "olga", "client": ""}, "expires_in_s": 9.0}
    daemons["fast"].answers["GET status"] = {**STATUS, "state": "READY", "lease": lease}
    daemons["slow"].refuse("POST arm", 409, "refused", "no")

    with StageGroup("raster") as group, pytest.raises(GroupError, match="nothing was changed"):
        group.arm()

    assert asked(daemons["fast"]) == ["POST lease", "POST arm"]


def test_lease_of_another_client_changes_nothing(daemons: Daemons) -> None:
    """No stage gets the request if the lease of one is held."""
    daemons["slow"].refuse("POST lease", 409, "lease_held", "olga holds the lease")

    with StageGroup("raster") as group, pytest.raises(GroupError, match="nothing was changed"):
        group.resume()

    assert asked(daemons["fast"]) == ["POST lease", "DELETE lease"]
    assert asked(daemons["slow"]) == ["POST lease"]


def test_stage_that_does_not_run_changes_nothing(daemons: Daemons) -> None:
    """A request needs all stages; the text names the missing one."""
    with StageGroup(("fast", "absent")) as group, pytest.raises(GroupError) as caught:
        group.arm()

    assert isinstance(caught.value.failed["absent"], NotRunningError)
    assert "arm failed on absent: no daemon is running for stage 'absent'" in str(caught.value)
    assert asked(daemons["fast"]) == []


def test_waves_begin_at_one_instant(daemons: Daemons) -> None:
    """All stages get the same start; a stage without a waveform gets nothing."""
    with StageGroup("raster") as group:
        before_s = time.monotonic()
        both = group.wave({"fast": {"x": SWING}, "slow": {"y": SWING}}, 2.0, start_in_s=0.5)
        group.wave({"slow": {"y": SWING}}, 2.0)

    bodies = [daemon.asked[-1].body for daemon in daemons.values()]
    assert [body["command_um"].keys() for body in bodies] == [{"x"}, {"y"}]
    assert daemons["fast"].asked[-1].body["start_s"] == both.start_s >= before_s + 0.5
    assert len([each for each in asked(daemons["fast"]) if each == "POST wave"]) == 1
    assert bodies[1]["start_s"] > both.start_s


def test_wave_that_one_stage_refuses_holds_the_others(daemons: Daemons) -> None:
    """The stage that follows its waveform holds."""
    daemons["fast"].refuse("POST wave", 409, "refused", "start_s is too early")

    with (
        StageGroup("raster") as group,
        pytest.raises(GroupError, match=r"wave failed on fast: start_s is too early \(.*slow held"),
    ):
        group.wave({"fast": {"x": SWING}, "slow": {"y": SWING}}, 2.0)

    assert asked(daemons["slow"]) == ["POST lease", "POST wave", "POST hold", "DELETE lease"]


def test_invalid_waveform_reaches_no_stage(daemons: Daemons) -> None:
    """It is refused before anything is sent."""
    with StageGroup("raster") as group, pytest.raises(RefusedError, match="frequency_hz"):
        group.wave({"fast": {"x": SWING}, "slow": {"y": SWING | {"frequency_hz": -1.0}}}, 2.0)

    assert asked(daemons["fast"]) == asked(daemons["slow"]) == []


def test_tables_begin_at_one_instant(daemons: Daemons) -> None:
    """Each device gets its own table, and all get the same start."""
    table = {"drive_v": [1.0, 2.0], "interval_s": 1e-4, "cycles": 3}
    with StageGroup("raster") as group:
        started = group.play({"fast": table, "slow": {**table, "axis": "y"}})

    bodies = [daemon.asked[-1].body for daemon in daemons.values()]
    assert [body["start_s"] for body in bodies] == [started.start_s] * 2
    assert bodies[1]["axis"] == "y"


def test_recordings_have_one_time_zero(daemons: Daemons) -> None:
    """All recordings begin at the same instant."""
    for name, daemon in daemons.items():
        daemon.answers["POST recordings/start"] = {"name": name}
    with StageGroup("raster") as group:
        started = group.start_recording("scan")

    bodies = [daemon.asked[-1].body for daemon in daemons.values()]
    assert {each.name for each in started.values()} == {"fast", "slow"}
    assert bodies[0] == bodies[1]
    assert bodies[0]["label"] == "scan"
    assert bodies[0]["start_s"] > 0.0


def test_recording_that_one_stage_refuses_is_ended(daemons: Daemons) -> None:
    """The recordings of the others end."""
    daemons["fast"].answers["POST recordings/start"] = {"name": "a"}
    daemons["fast"].answers["POST recordings/stop"] = {"name": "a"}
    daemons["slow"].refuse("POST recordings/start", 409, "refused", "the disk is full")

    with StageGroup("raster") as group, pytest.raises(GroupError, match="fast recording ended"):
        group.start_recording()


@pytest.mark.parametrize("verb", ["hold", "disarm", "stop", "estop"])
def test_request_towards_safety_reaches_all(
    daemons: Daemons, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    """A daemon that hangs and one that has ended delay no other, and nothing is taken back."""
    monkeypatch.setattr(group_requests, "STOP_WITHIN_S", 1.0)
    daemons["fast"].answering.clear()

    with (
        StageGroup(("fast", "absent", "slow")) as group,
        pytest.raises(GroupError, match=rf"{verb} failed on fast: .*absent: .*\(done on slow\)"),
    ):
        getattr(group, verb)()

    assert asked(daemons["slow"]) == [f"POST {verb}"]
    daemons["fast"].answering.set()


def test_doubtful_request_is_taken_back_too(
    daemons: Daemons, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage that did not answer may have armed; a refusal to disarm means that it had not."""
    monkeypatch.setattr(group_requests, "ANSWER_WITHIN_S", 0.2)
    daemons["slow"].refuse("POST arm", 500, "broken", "the daemon is confused")
    daemons["slow"].refuse("POST disarm", 409, "refused", "there is nothing to disarm")

    with StageGroup("raster") as group, pytest.raises(GroupError) as caught:
        group.arm()

    assert "(taken back: fast disarmed)" in str(caught.value)
    assert asked(daemons["slow"]) == ["POST lease", "POST arm", "POST disarm", "DELETE lease"]


def test_request_that_cannot_be_taken_back_is_named(daemons: Daemons) -> None:
    """A stage that stays armed is in the text."""
    daemons["fast"].refuse("POST disarm", 500, "broken", "the daemon is confused")
    daemons["slow"].refuse("POST arm", 409, "refused", "no")

    with StageGroup("raster") as group, pytest.raises(GroupError) as caught:
        group.arm()

    assert "taken back: fast NOT taken back, the daemon is confused" in str(caught.value)


def test_sessions_of_all_stages(daemons: Daemons) -> None:
    """A session binds every stage; if one refuses, there is none."""
    with StageGroup("raster") as group:
        with group.session():
            pass
        daemons["slow"].refuse("POST session", 409, "lease_held", "olga holds the lease")
        with pytest.raises(RefusedError, match="olga"), group.session():
            pytest.fail("there is no session")

    assert asked(daemons["fast"]).count("POST session") == 2


def test_only_stages_of_the_group_are_reached(daemons: Daemons) -> None:
    """A name that is not in the group is refused."""
    with StageGroup("raster") as group:
        assert group.status()["fast"].stage == "fast"
        with pytest.raises(RefusedError, match="stage 'x' is not in the group, which has fast, sl"):
            group.client("x")
    assert asked(daemons["fast"]) == []


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "no such file: write the groups of this machine into it"),
        ("groups: {other: [a]}\n", "groups: no group 'raster', known: other"),
        ("groups: {raster: [a, b, a]}\n", "groups.raster: a appears 2 times, allowed: once"),
        ("groups: {raster: []}\n", "groups.raster: a group has at least one stage"),
        ("groups: {raster: [a/b]}\n", r"groups.raster\[0\]"),
        ("raster: [a]\n", "groups: required key is missing"),
    ],
)
def test_file_of_groups_that_cannot_be_used(tmp_path: Path, text: str | None, why: str) -> None:
    """Every problem of the file is reported with its place."""
    file = tmp_path / "groups.yaml"
    if text is not None:
        file.write_text(text, encoding="utf-8")

    with pytest.raises(ConfigError, match=why):
        StageGroup("raster", file=file)
