import signal
from collections.abc import Iterator
from math import isnan
from pathlib import Path

import pytest

from piezod.config.requests import Arm, Goto, Shutdown
from piezod.config.states import State
from piezod.daemon.last_output import read_last_output
from piezod.daemon.noted_identities import noted_identities
from piezod.telemetry.words import Word
from tests.daemon.loop_child import LoopChild
from tests.daemon.waiting import eventually

CONFIG = Path(__file__).parents[3] / "config"
SIMULATED = CONFIG / "simulated.yaml"


@pytest.fixture
def child(tmp_path: Path) -> Iterator[LoopChild]:
    """Return a loop process on the simulated stage, disarmed.

    It is slow: on a busy machine a fast one would stop for its own lateness.
    """
    config = config_with(tmp_path, "rate_hz: 1000", "rate_hz: 20")
    with LoopChild(tmp_path, config) as child:
        child.wait_for(State.SAFE)
        yield child


def config_with(tmp_path: Path, before: str, after: str, name: str = "simulated.yaml") -> Path:
    """Return a shipped configuration with a part of its text replaced."""
    text = (CONFIG / name).read_text(encoding="utf-8")
    assert before in text
    text = text.replace("models/", f"{CONFIG}/models/").replace(before, after)
    path = tmp_path / "stage.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_stage_moves_and_comes_back(child: LoopChild) -> None:
    """Armed, it goes where it is told; told to end, it does so at the safe voltage, with code 0."""
    armed, moving = child.ask(Arm()), child.ask(Goto(position_um=5.0))
    eventually(lambda: child.latest()["axes"][0]["on_target"])
    [moved] = read_last_output(child.runtime / "output.map")

    leaving = child.ask(Shutdown())
    code = child.ended()

    assert armed.accepted
    assert (moving.accepted, moving.motion > 0) == (True, True)
    assert moved.drive_v > 5.0
    assert leaving.accepted
    assert code == 0
    [left] = read_last_output(child.runtime / "output.map")
    assert left.drive_v == pytest.approx(0.0, abs=0.1)


def test_devices_are_on_record(child: LoopChild) -> None:
    """By their names in the configuration, for whoever has to bring the stage down without them."""
    [(name, who)] = noted_identities(child.runtime / "identities.json").items()

    assert (name, who.model) == ("rig", "simulated stack")


@pytest.mark.fault("H1")
def test_stage_without_supervisor_comes_back_by_itself(child: LoopChild) -> None:
    """A supervisor that is silent is gone: the loop ramps down and ends."""
    child.ask(Arm())
    child.ask(Goto(position_um=5.0))
    eventually(lambda: child.latest()["axes"][0]["drive_v"] > 1.0)

    child.silent.set()

    assert child.ended() == 0
    [left] = read_last_output(child.runtime / "output.map")
    assert left.drive_v == pytest.approx(0.0, abs=0.1)
    assert "H1" in {event.fault for event in child.events}


def test_signals_are_for_the_supervisor(child: LoopChild) -> None:
    """Ctrl-C in a terminal reaches all its processes; the loop waits to be told."""
    cycles = child.shared.words[Word.HEALTHY_CYCLES]

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        child.process.send_signal(number)

    eventually(lambda: child.shared.words[Word.HEALTHY_CYCLES] > cycles + 5)
    assert child.process.poll() is None


def test_process_tells_what_it_obtained(child: LoopChild) -> None:
    """Before its first cycle: each step, and the rate that it can keep."""
    report = child.shared.report()

    assert report["steps"][-1]["name"] == "scheduling"
    assert [one["placement"] for one in report["devices"]] == ["in the cycle"]
    assert child.shared.words[Word.MEASURED_RATE_HZ] > 0
    assert child.shared.words[Word.LOOP_PID] == child.process.pid
    assert isnan(read_last_output(child.runtime / "output.map")[0].drive_v)


def test_faster_than_measured_is_not_armed(tmp_path: Path) -> None:
    """The rig follows 20 kHz at most, and a cycle takes longer than that leaves time for."""
    config = config_with(tmp_path, "rate_hz: 1000", "rate_hz: 20000")
    with LoopChild(tmp_path, config) as child:
        child.wait_for(State.SAFE)

        answer = child.ask(Arm())

    assert not answer.accepted
    assert "choose a lower rate" in answer.why


def test_absent_device_is_waited_for(tmp_path: Path) -> None:
    """BLIND and alive, refusing with the reason, until it is told to end."""
    config = config_with(tmp_path, "rig.sock", f"{tmp_path}/rig.sock", "emulated.yaml")
    with LoopChild(tmp_path, config) as child:
        child.wait_for(State.BLIND)
        cycles = child.shared.words[Word.HEALTHY_CYCLES]
        eventually(lambda: child.shared.words[Word.HEALTHY_CYCLES] > cycles)

        armed, ended = child.ask(Arm()), child.ask(Shutdown())

        assert not armed.accepted
        assert armed.why == child.events[0].text
        assert ended.accepted
        assert child.ended() == 0
        assert not child.shared.words[Word.DEVICES_OPEN]


@pytest.mark.fault("P2")
def test_after_an_unclean_end_somebody_must_look(tmp_path: Path) -> None:
    """The stage is not armed before a reset."""
    with LoopChild(tmp_path, SIMULATED, UNCLEAN=1) as child:
        child.wait_for(State.FAULT, State.SAFE)

        answer = child.ask(Arm())

    assert not answer.accepted
    assert "P2" in {event.fault for event in child.events}
