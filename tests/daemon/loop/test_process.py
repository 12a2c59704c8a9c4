import signal
from collections.abc import Iterator
from math import isnan
from pathlib import Path

import pytest

from piezod import build
from piezod.config.states import State
from piezod.daemon.last_output import LastOutputReader
from piezod.daemon.noted_identities import noted_identities
from piezod.messages.requests import Arm, Goto, Shutdown
from piezod.telemetry.words import HUNG, Word
from tests.daemon.loop_child import LoopChild
from tests.daemon.waiting import eventually

CONFIG = Path(__file__).parents[3] / "config"
SIMULATED = CONFIG / "simulated.yaml"


@pytest.fixture
def child(tmp_path: Path) -> Iterator[LoopChild]:
    """Return a loop process of the simulated stage, disarmed.

    It is slow: on a busy machine a faster one would stop because of late cycles.
    """
    config = config_with(tmp_path, "rate_hz: 200", "rate_hz: 20")
    with LoopChild(tmp_path, config) as child:
        child.wait_for(State.SAFE)
        yield child


@pytest.fixture(scope="module")
def resting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LoopChild]:
    """Return a disarmed loop process that tests share which only look at it."""
    folder = tmp_path_factory.mktemp("resting")
    with LoopChild(folder, config_with(folder, "rate_hz: 200", "rate_hz: 20")) as child:
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
    """An armed stage reaches its target; a shutdown ends at the safe voltage with code 0."""
    armed, moving = child.ask(Arm()), child.ask(Goto(position_um=5.0))
    eventually(lambda: child.latest()["axes"][0]["on_target"])
    [moved] = LastOutputReader(child.runtime / "output.map").read()

    leaving = child.ask(Shutdown())
    code = child.ended()

    assert armed.accepted
    assert (moving.accepted, moving.motion > 0) == (True, True)
    assert moved.drive_v > 5.0
    assert leaving.accepted
    assert code == 0
    [left] = LastOutputReader(child.runtime / "output.map").read()
    assert left.drive_v == pytest.approx(0.0, abs=0.1)


def test_identities_are_stored(resting: LoopChild) -> None:
    """`piezod safe` finds the identity of each device by its name in the configuration."""
    [(name, who)] = noted_identities(resting.runtime / "identities.json").items()

    assert (name, who.model) == ("rig", "simulated stack")


def test_signals_are_for_the_supervisor(resting: LoopChild) -> None:
    """The loop ignores Ctrl-C, which a terminal sends to all its processes."""
    cycles = resting.shared.words[Word.HEALTHY_CYCLES]

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        resting.process.send_signal(number)

    eventually(lambda: resting.shared.words[Word.HEALTHY_CYCLES] > cycles + 5)
    assert resting.process.poll() is None


def test_process_reports_what_it_obtained(resting: LoopChild) -> None:
    """Before the first cycle it reports each real-time step and the rate that it sustains."""
    report = resting.shared.report()

    assert report["steps"][-1]["name"] == "scheduling"
    assert [one["placement"] for one in report["devices"]] == ["in the cycle"]
    assert resting.shared.words[Word.MEASURED_RATE_HZ] > 0
    assert resting.shared.words[Word.LOOP_PID] == resting.process.pid
    assert isnan(LastOutputReader(resting.runtime / "output.map").read()[0].drive_v)


@pytest.mark.skipif(build() == "compiled", reason="a compiled cycle is short enough for 20 kHz")
def test_rate_above_the_measured_one_is_not_armed(tmp_path: Path) -> None:
    """At 20 kHz the cycle is too long: the log says so at the start, and arming is refused."""
    config = config_with(tmp_path, "rate_hz: 200", "rate_hz: 20000")
    with LoopChild(tmp_path, config) as child:
        child.wait_for(State.SAFE)

        # Before the first read-back the voltage in force is unknown, which is refused, too.
        eventually(lambda: "choose a lower rate" in child.ask(Arm()).why)
        told = [event.text for event in child.events if event.kind == "rate"]

    assert len(told) == 1
    assert "the stage is only observed" in told[0]


def test_absent_device_is_waited_for(tmp_path: Path) -> None:
    """The process is BLIND and alive, refuses with the reason, and ends on a shutdown."""
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
@pytest.mark.fault("L3")
def test_arming_after_a_loop_that_hung_needs_a_reset(tmp_path: Path) -> None:
    """After an unclean end, P2 forbids arming, and L3 if its loop hung."""
    with LoopChild(tmp_path, SIMULATED, UNCLEAN=HUNG) as child:
        child.wait_for(State.FAULT, State.SAFE)

        answer = child.ask(Arm())

    assert not answer.accepted
    assert {"P2", "L3"} <= {event.fault for event in child.events}
