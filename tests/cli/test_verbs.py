"""The verbs for a running daemon."""

import json
from pathlib import Path
from typing import Any

import pytest

from piezod.cli.move.outcome import outcome
from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.config.waveforms.swings import SWINGS
from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN
from tests.cli.conftest import Command
from tests.client.fake_daemon import ACCEPTED, STATUS, FakeDaemon, Raw, interval


@pytest.mark.parametrize(
    ("arguments", "what", "body", "text"),
    [
        ("arm", "arm", {"shadow": False, "confirm_output": False}, "armed"),
        (
            "arm --shadow",
            "arm",
            {"shadow": True, "confirm_output": False},
            "in shadow: nothing is written",
        ),
        ("disarm", "disarm", {}, "ramping to the safe voltage"),
        ("mode adaptive", "mode", {"mode": "adaptive"}, "mode adaptive"),
        ("mode trimmed --axis y", "mode", {"mode": "trimmed", "axis": "y"}, "mode trimmed"),
        ("goto 12.5", "goto", {"position_um": 12.5}, "going to 12.5 µm"),
        ("goto -5 --axis x", "goto", {"position_um": -5.0, "axis": "x"}, "going to -5 µm"),
        ("goto 3 --speed 2", "goto", {"position_um": 3.0, "speed_um_per_s": 2.0}, "going to 3"),
        ("follow", "follow", {}, "following the command input"),
        ("follow --axis x", "follow", {"axis": "x"}, "following the command input"),
        ("hold", "hold", {}, "holding the voltage"),
        ("resume", "resume", {}, "continuing"),
        ("condition --axis x", "condition", {"axis": "x"}, "conditioning"),
        ("zero", "zero", {}, "zero from now on"),
        ("stop", "stop", {}, "ramping"),
        ("estop", "estop", {}, "emergency stop"),
        ("reset --engineer", "reset", {"engineer": True}, "reset"),
        ("reload", "reload", {}, "read again"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_command(
    piezod: Command, daemon: FakeDaemon, arguments: str, what: str, body: object, text: str
) -> None:
    """A verb posts its request, and prints one line when it is accepted."""
    code, out, err = piezod(*arguments.split())

    assert (code, err) == (0, "")
    assert [(each.what, each.body) for each in daemon.asked] == [(f"POST {what}", body)]
    assert text in out
    assert out.count("\n") == 1


@pytest.mark.parametrize(
    ("verb", "state", "text"),
    [
        ("stop", "RAMP", "ramping to the safe voltage"),
        ("stop", "SAFE", "no change, the stage is in SAFE: nothing is driven"),
        (
            "stop",
            "FAULT",
            "no change, the stage is in FAULT: nothing is written; `piezod faults` shows the cause",
        ),
        (
            "hold",
            "RAMP",
            "no change, the stage is in RAMP: the ramp to the safe voltage goes on",
        ),
        (
            "estop",
            "BLIND",
            "not yet, the stage is in BLIND: nothing can be sent to the amplifier; the request "
            "will be carried out when it answers; `piezod faults` shows the cause",
        ),
        ("estop", "ESTOP", "emergency stop; `piezod reset` ends it"),
        ("resume", "READY", "continuing from the present position"),
    ],
)
def test_request_towards_safety_prints_what_happens(
    piezod: Command, daemon: FakeDaemon, verb: str, state: str, text: str
) -> None:
    """The printed text depends on the state after the request."""
    daemon.answers[f"POST {verb}"] = {**ACCEPTED, "state": state}

    assert piezod(verb) == (0, f"{text}\n", "")


@pytest.mark.parametrize("state", State)
def test_every_state_has_a_text(state: State) -> None:
    """A stop is explained in every state."""
    assert str(state) in outcome("stop", "", state) or state is State.RAMP


def test_reload_prints_what_has_changed_and_what_is_lost(
    piezod: Command, daemon: FakeDaemon
) -> None:
    """Each loss has a line with its remedy."""
    lost = "axis x: the sensor zero, because it has no model; `piezod zero` again"
    daemon.answers["POST reload"] = {"changes": ["axes.x.model", "rate_hz"], "lost": [lost]}
    changed = "the configuration has been read again, changed: axes.x.model, rate_hz"

    assert piezod("reload") == (0, f"{changed}\nlost: {lost}\n", "")


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize("verb", ["arm", "stop", "goto 1", "mode adaptive", "reload", "zero"])
def test_command_as_json(piezod: Command, verb: str) -> None:
    """With --json stdout has the answer of the daemon and nothing else."""
    code, out, err = piezod(*verb.split(), "--json")

    assert (code, json.loads(out), err) == (0, ACCEPTED, "")


def test_commands_have_no_name(piezod: Command, daemon: FakeDaemon) -> None:
    """Verbs have no client name, so that they share the lease with the scripts of the user."""
    piezod("arm")
    piezod("goto", "1")

    assert {each.client for each in daemon.asked} == {""}


@pytest.mark.usefixtures("daemon")
def test_status(piezod: Command) -> None:
    """Status shows state, axes and faults."""
    code, out, _ = piezod("status")

    assert code == 0
    assert "simulated: RUN, mode adaptive, 3 skipped cycles" in out
    assert "x" in out
    assert " ".join(out.split()).count("12.400 12.500 0.100 60.00 on target") == 1
    assert "S5" in out
    assert "look at it" in out


def test_status_without_positions(piezod: Command, daemon: FakeDaemon) -> None:
    """An unknown number is shown as a dash."""
    axis = {"position_um": None, "command_um": None, "drive_v": 0.0}
    daemon.answers["GET status"] = {**STATUS, "shadow": True, "faults": [], "axes": {"x": axis}}

    _, out, _ = piezod("status")

    assert "x – – – 0.00" in " ".join(out.split())
    assert "in shadow: nothing is written" in out


def test_status_has_each_device(piezod: Command, daemon: FakeDaemon) -> None:
    """Status shows identity, placement, round trips and capabilities of each device."""
    able = {"read_back": True, "holds": True, "enables": False, "soft_disable": False}
    device = {
        "name": "amp",
        "identity": {"maker": "Acme", "model": "A1", "serial": "7", "firmware": "2"},
        "placement": "behind a worker",
        "round_trip_us": {"p50": 812.4, "p99": 1203.0},
        "capabilities": {**able, "watchdog": False, "quality": False},
    }
    daemon.answers["GET status"] = {**STATUS, "faults": [], "devices": [device]}

    _, out, _ = piezod("status")

    for shown in ("amp", "Acme A1 7", "behind a worker", "812", "1203", "reads back, holds"):
        assert shown in out


def test_status_shows_a_shared_processor(piezod: Command, daemon: FakeDaemon) -> None:
    """The processor is in the first line; a shared one has a line with the remedy."""
    daemon.answers["GET status"] = {**STATUS, "processor": {"number": 3, "shared_with": 2}}

    out = " ".join(piezod("status").out.split())

    assert "mode adaptive, processor 3" in out
    assert "Processor 3 had 3 loops when this one started" in out


@pytest.mark.usefixtures("daemon")
def test_status_tells_of_this_stage_only(piezod: Command) -> None:
    """What no stage ever shows is no part of a status: `piezod faults --undetected` has it."""
    _, out, _ = piezod("status")
    code, text, _ = piezod("status", "--json")

    assert not {*NEVER_SHOWN, *GAPS}.intersection(out.split())
    assert (code, json.loads(text)) == (0, STATUS)


def test_faults(piezod: Command, daemon: FakeDaemon) -> None:
    """Each fault is shown with its remedy; without faults one line says so."""
    daemon.answers["GET faults"] = {"faults": STATUS["faults"]}
    _, out, _ = piezod("faults")
    assert "S5" in out
    assert "present" in out
    assert "look at it" in out
    _, out, _ = piezod("faults", "--json")
    assert json.loads(out) == {"faults": STATUS["faults"]}

    daemon.answers["GET faults"] = {"faults": []}
    assert piezod("faults") == (0, "no fault\n", "")


def test_faults_that_are_never_shown_are_listed_with_the_reason(piezod: Command) -> None:
    """No stage needs to run."""
    _, out, _ = piezod("faults", "--undetected")
    _, text, _ = piezod("faults", "--undetected", "--json")

    assert f"L9 real-time privileges missing: {NEVER_SHOWN[Fault.L9]}" in out
    assert json.loads(text) == {"never_shown": dict(NEVER_SHOWN), "gaps": dict(GAPS)}


def test_metrics(piezod: Command, daemon: FakeDaemon) -> None:
    """The text of the daemon is printed unchanged."""
    text = "# HELP piezod_healthy Whether it runs.\npiezod_healthy 1.0\n"
    daemon.answers["GET metrics"] = Raw(200, text.encode(), "text/plain")

    assert piezod("metrics") == (0, text, "")


def test_metrics_that_are_refused(piezod: Command, daemon: FakeDaemon) -> None:
    """An error is no text for Prometheus."""
    daemon.refuse("GET metrics", 429, "too_many", "too many requests", "send fewer")

    assert piezod("metrics") == (1, "", "too many requests; send fewer\n")


def test_goto_that_waits(piezod: Command, daemon: FakeDaemon) -> None:
    """With --wait goto ends when the stage has arrived, and prints the position."""
    daemon.telemetry = [interval(), interval(12.51, on_target=True)]

    assert piezod("goto", "12.5", "--wait") == (0, "at 12.510 µm\n", "")
    _, out, _ = piezod("goto", "12.5", "--wait", "--json")
    assert json.loads(out) == {"axis": "x", "motion": 7, "position_um": 12.51}


def test_goto_that_waits_in_vain(piezod: Command, daemon: FakeDaemon) -> None:
    """If the movement ends early the reason is on stderr, and the exit code is 1."""
    daemon.telemetry = [interval(), interval(state="HOLD", faults=["S5"])]

    code, out, err = piezod("goto", "12.5", "--wait", "--timeout", "5")

    assert (code, out) == (1, "")
    assert err == (
        "axis x: the stage went to HOLD because of S5 before it reached the target; "
        "`piezod faults` shows more\n"
    )


WAVE = """\
command_um: {axes: {x: {kind: sine, low: 0, high: 10, frequency_hz: 2}}}
duration_s: 5
"""


def wave_of(daemon: FakeDaemon) -> Any:
    """Return the body of the last wave."""
    return [asked.body for asked in daemon.asked if asked.what == "POST wave"][-1]


def test_wave_of_a_file(piezod: Command, daemon: FakeDaemon, folder: Path) -> None:
    """A file has the waveforms of experiments; paths in it are relative to its folder."""
    (folder / "wave.yaml").write_text(WAVE, encoding="utf-8")
    assert piezod("wave", "wave.yaml") == (0, "following for 5 s\n", "")
    assert wave_of(daemon)["command_um"]["x"]["frequency_hz"] == 2
    assert wave_of(daemon)["duration_s"] == 5

    assert piezod("wave", "wave.yaml", "--duration", "7").out == "following for 7 s\n"
    assert wave_of(daemon)["duration_s"] == 7

    (folder / "sub").mkdir()
    (folder / "sub" / "a.csv").write_text("t_s,x\n0,0\n1,5\n", encoding="utf-8")
    text = "command_um: {axes: {x: {kind: csv, path: a.csv, column: x}}}\nduration_s: 1\n"
    (folder / "sub" / "wave.yaml").write_text(text, encoding="utf-8")
    assert piezod("wave", "sub/wave.yaml").code == 0
    assert wave_of(daemon)["command_um"]["x"]["points"] == [[0.0, 0.0], [1.0, 5.0]]


@pytest.mark.parametrize("kind", SWINGS)
def test_wave_of_the_command_line(piezod: Command, daemon: FakeDaemon, kind: str) -> None:
    """A swing needs numbers only, for the only axis."""
    numbers = {each.key: each.start for each in SWINGS[kind]} | {"low": -1.0}
    arguments = ("wave", f"--{kind}", *map(str, numbers.values()), "--duration", "3")

    assert piezod(*arguments).code == 0
    waveform = wave_of(daemon)["command_um"]["x"]
    assert waveform.items() >= {"kind": kind, **numbers}.items()
    assert piezod(*arguments, "--axis", "y").code == 0
    assert wave_of(daemon)["command_um"].keys() == {"y"}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ("", "give one of FILE, --sine"),
        ("--sine 0 1 1 --triangle 0 1 1 --duration 1", "give one of"),
        ("--sine 0 1 1", "need --duration"),
        ("wave.yaml --axis x", "FILE names its axes"),
        ("no.yaml", "no such file"),
        ("--sine 0 1 1 --duration 1", "name one of the axes x, y with --axis"),
        ("wave.yaml --stage a --socket b", "exclude each other"),
    ],
)
def test_wave_used_wrongly(
    piezod: Command, daemon: FakeDaemon, folder: Path, arguments: str, text: str
) -> None:
    """Contradictory options are wrong usage."""
    (folder / "wave.yaml").write_text(WAVE, encoding="utf-8")
    axis = STATUS["axes"]["x"]
    daemon.answers["GET status"] = {**STATUS, "axes": {"x": axis, "y": axis}}

    code, out, err = piezod("wave", *arguments.split())

    assert (code, out) == (2, "")
    assert text in " ".join(err.split())


def test_wave_that_is_not_valid(piezod: Command, daemon: FakeDaemon, folder: Path) -> None:
    """A file is checked before anything is sent; every problem has its place."""
    text = WAVE.replace("high: 10", "high: -1").replace("5", "five")
    (folder / "wave.yaml").write_text(text, encoding="utf-8")

    code, _, err = piezod("wave", "wave.yaml")

    assert code == 78
    assert "wave.yaml:1:51: command_um.axes.x.high: must be above low" in err
    assert "wave.yaml:2:13: duration_s: must be a number" in err
    assert daemon.asked == []


def test_refusal(piezod: Command, daemon: FakeDaemon) -> None:
    """A refused request exits with 1; reason and remedy are on stderr."""
    daemon.refuse("POST goto", 409, "refused", "the stage is SAFE", "piezod arm")

    assert piezod("goto", "1") == (1, "", "the stage is SAFE; piezod arm\n")


def test_user_without_the_right(piezod: Command, daemon: FakeDaemon) -> None:
    """A request that the role does not allow exits with 77."""
    daemon.refuse("POST arm", 403, "forbidden", "eve has the role viewer, this needs operator")

    assert piezod("arm") == (77, "", "eve has the role viewer, this needs operator\n")


def test_no_daemon(piezod: Command, folder: Path) -> None:
    """Without a daemon the exit code is 69."""
    code, out, err = piezod("status", "--json", "--socket", folder / "api.sock")

    assert (code, out) == (69, "")
    assert "no daemon is running there; start it with `piezod run CONFIG`" in err


def test_several_daemons(
    piezod: Command, daemon: FakeDaemon, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With several daemons and no name the usage is wrong."""
    monkeypatch.delenv("PIEZOD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    for name in ("afm", "bench"):
        (folder / "piezod" / name).mkdir(parents=True)
        (folder / "piezod" / name / "api.sock").symlink_to(daemon.socket_path)

    code, out, err = piezod("stop")
    assert (code, out) == (2, "")
    assert "several stages are running: afm, bench" in err
    assert "name one with --stage" in err
    assert piezod("stop", "--stage", "afm").code == 0


def test_impossible_value(piezod: Command, daemon: FakeDaemon) -> None:
    """An impossible value is not sent."""
    code, _, err = piezod("goto", "nan")

    assert code == 1
    assert "position_um: must be a finite number (got .nan), allowed range" in err
    assert daemon.asked == []


def test_fast_wave_is_told(piezod: Command, daemon: FakeDaemon) -> None:
    """Above a tenth of the rate a warning goes to stderr; the wave runs."""
    daemon.answers["GET config"] = {"rate_hz": 100}
    code, out, err = piezod("wave", "--sine", "2", "20", "20", "--duration", "2")

    assert (code, out) == (0, "following for 2 s\n")
    assert "20 Hz is more than a tenth of the rate, 100 Hz" in " ".join(err.split())
    assert piezod("wave", "--sine", "2", "20", "10", "--duration", "2").err == ""
