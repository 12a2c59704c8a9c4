"""`piezod list` and `piezod group`."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Command
from tests.client.fake_daemon import ACCEPTED, STATUS, interval
from tests.client.group_of_fakes import Daemons, asked


def test_list(piezod: Command, daemons: Daemons) -> None:
    """Each stage is a line, with its whole socket."""
    more = {"rate_hz": 1000.0, "processor": {"number": 3, "shared_with": 0}}
    daemons["slow"].answers["GET status"] = {**STATUS, **more}

    code, out, err = piezod("list")

    head, fast, slow = out.splitlines()
    assert (code, err) == (0, "")
    assert head.split() == [
        "stage",
        "state",
        "rate/Hz",
        "processor",
        "axes",
        "faults",
        "lease",
        "socket",
    ]
    assert fast.split()[:4] == ["fast", "SAFE", "–", "–"]
    socket = str(daemons["slow"].socket_path)
    assert slow.split() == ["slow", "RUN", "1000", "3", "x", "S5", "free", socket]


def test_list_of_nothing(piezod: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a stage the command to start one is shown."""
    monkeypatch.setattr("piezod.client.listing.running_stages", dict)

    assert "`piezod run CONFIG` starts one" in piezod("list").out
    assert json.loads(piezod("list", "--json").out) == {"stages": []}


def test_list_for_programs(piezod: Command, daemons: Daemons) -> None:
    """A stage without a status has the reason in place of it."""
    daemons["slow"].refuse("GET status", 403, "forbidden", "no role")

    fast, slow = json.loads(piezod("list", "--json").out)["stages"]

    assert (fast["stage"], fast["state"], fast["axes"], fast["why"]) == ("fast", "SAFE", ["x"], "")
    socket = str(daemons["slow"].socket_path)
    assert slow == {"stage": "slow", "socket": socket, "why": "no role", "state": None}


@pytest.mark.parametrize(
    ("verb", "requests"),
    [
        ("arm", ["POST lease", "POST arm"]),
        ("resume", ["POST lease", "POST resume"]),
        ("hold", ["POST hold"]),
        ("disarm", ["POST disarm"]),
        ("stop", ["POST stop"]),
        ("estop", ["POST estop"]),
    ],
)
def test_verb_for_a_group(
    piezod: Command, daemons: Daemons, verb: str, requests: list[str]
) -> None:
    """A verb is sent to each stage, and the state of each is printed."""
    for daemon in daemons.values():
        daemon.answers[f"POST {verb}"] = {**ACCEPTED, "state": "HOLD"}

    assert piezod("group", verb, "raster") == (0, "fast: HOLD\nslow: HOLD\n", "")
    assert [asked(daemon) for daemon in daemons.values()] == [requests] * 2


def test_refusal_is_for_the_whole_group(piezod: Command, daemons: Daemons) -> None:
    """The exit code is 1, and the text says which stage refused and why."""
    daemons["slow"].refuse("POST arm", 409, "refused", "in FAULT", "`piezod reset`")

    assert piezod("group", "arm", "raster") == (
        1,
        "",
        "group raster: arm failed on slow: in FAULT (taken back: fast disarmed); `piezod reset`\n",
    )


def test_status_of_a_group(piezod: Command, daemons: Daemons, tmp_path: Path) -> None:
    """A stage of the group that does not run is shown, and the exit code is 1."""
    file = tmp_path / "groups.yaml"
    file.write_text("groups: {raster: [fast, absent], all: [fast, slow]}\n", encoding="utf-8")

    code, out, _ = piezod("group", "status", "raster", "--groups", file)

    assert code == 1
    assert out.splitlines()[2].endswith("–  ! no daemon is running")
    assert piezod("group", "status", "all", "--groups", file).code == 0
    assert asked(daemons["fast"]) == []


WAVES = """
stages:
  fast: {kind: sine, low: 1, high: 9, frequency_hz: 2}
  slow: {axes: {y: {kind: setpoint, level: 3}}}
duration_s: 4
"""


def test_wave_of_a_group(piezod: Command, daemons: Daemons, folder: Path) -> None:
    """A waveform without an axis is for the only one; all begin at one instant."""
    (folder / "waves.yaml").write_text(WAVES, encoding="utf-8")

    code, out, err = piezod("group", "wave", "raster", "waves.yaml", "--json")

    bodies = [daemon.asked[-1].body for daemon in daemons.values()]
    assert (code, err) == (0, "")
    assert [list(body["command_um"]) for body in bodies] == [["x"], ["y"]]
    assert {body["start_s"] for body in bodies} == {json.loads(out)["start_s"]}
    assert json.loads(out)["stages"] == {"fast": ACCEPTED, "slow": ACCEPTED}
    assert "fast: following for 4 s, from" in piezod("group", "wave", "raster", "waves.yaml").out


def test_goto_of_a_group(piezod: Command, daemons: Daemons) -> None:
    """A target is for the only axis, or names one; with --wait the positions are printed."""
    axis = {"limits": {"drive_min_v": 0.0, "drive_max_v": 150.0}, "sensor": {}}
    for daemon in daemons.values():
        daemon.answers["GET config"] = {"axes": {"x": axis}}
        daemon.telemetry, daemon.lasting = [interval(12.5, on_target=True)], True

    started = piezod("group", "goto", "raster", "fast=12.5", "slow/x=12.5")
    there = piezod("group", "goto", "raster", "fast=12.5", "slow/x=12.5", "--wait")
    invalid = piezod("group", "goto", "raster", "fast=far")

    assert started == (0, "fast: on its way\nslow: on its way\n", "")
    assert there == (0, "fast: x at 12.500 µm\nslow: x at 12.500 µm\n", "")
    assert (invalid.code, "is no target" in invalid.err) == (2, True)


def test_waveform_needs_the_axis_of_a_stage_with_several(
    piezod: Command, daemons: Daemons, folder: Path
) -> None:
    """Nothing is sent if the axis of a waveform is not clear."""
    (folder / "waves.yaml").write_text(WAVES, encoding="utf-8")
    axis = STATUS["axes"]["x"]
    daemons["fast"].answers["GET status"] = {**STATUS, "axes": {"x": axis, "y": axis}}

    code, _, err = piezod("group", "wave", "raster", "waves.yaml")

    assert code == 2
    assert "stage fast has the axes x, y" in " ".join(err.replace("│", "").split())
    assert asked(daemons["slow"]) == []


def test_play_of_a_group(piezod: Command, daemons: Daemons, folder: Path) -> None:
    """Each stage gets its own table."""
    table = "{drive_v: [0, 5, 0], interval_s: 0.0001, cycles: 3}"
    text = f"stages: {{fast: {table}, slow: {table}}}\n"
    (folder / "tables.yaml").write_text(text, encoding="utf-8")

    code, out, _ = piezod("group", "play", "raster", "tables.yaml", "--start-in", "2")

    bodies = [daemon.asked[-1].body for daemon in daemons.values()]
    assert code == 0
    assert "slow: playing, from" in out
    assert bodies[0] == bodies[1]
    assert bodies[0]["drive_v"] == [0.0, 5.0, 0.0]


def test_recording_of_a_group(piezod: Command, daemons: Daemons) -> None:
    """The recordings are started and ended together."""
    for name, daemon in daemons.items():
        daemon.answers["POST recordings/start"] = {"name": name}
        daemon.answers["POST recordings/stop"] = {"name": name, "records": 7}

    started = piezod("group", "record", "start", "raster", "scan")
    ended = piezod("group", "record", "stop", "raster")

    assert started == (0, "fast: recording fast\nslow: recording slow\n", "")
    assert "slow: recorded 7 cycles as slow" in ended.out
    assert daemons["fast"].asked[-2].body["label"] == "scan"


def test_unknown_group(piezod: Command, daemons: Daemons) -> None:
    """The known groups are in the message, and the exit code is that of a configuration."""
    code, _, err = piezod("group", "hold", "scanner")

    assert code == 78
    assert "groups: no group 'scanner', known: raster" in err
    assert asked(daemons["fast"]) == []
