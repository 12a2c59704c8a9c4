"""Reloads of a stage in the process of the test, with a loop without devices."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from subprocess import Popen

import httpx
import pytest

from piezod.config.states import State
from piezod.daemon.supervisor import processes
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from tests.daemon.daemons import configuration
from tests.daemon.supervisor.run_rig import Rig
from tests.daemon.waiting import eventually

LEFT = "axis x: the voltage is UNKNOWN: no device; the voltage stays at 60.00 V"


@pytest.mark.fault("P11")
def test_reload_that_fails_leaves_the_old_configuration(rig: Rig) -> None:
    """The client gets an error, and a loop with the old configuration runs again."""
    answers: list[httpx.Response] = []

    def reload() -> None:
        configuration(rig.config.parent, title="broken")
        answers.append(rig.ask("POST", "reload", {}))
        answers.append(rig.ask("GET", "config"))
        rig.up()

    assert rig.run(reload)
    assert answers[0].status_code == 409
    assert "the old one is in force" in answers[0].text
    assert answers[1].json()["title"] == "Simulated stack actuator"


@pytest.mark.fault("P11")
def test_second_reload_at_the_same_time_is_refused(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two exchanges would start two loops. Other commands do not wait for the first."""
    answers: list[httpx.Response] = []
    start = processes.start

    def start_held(module: str, *arguments: str) -> "Popen[bytes]":
        process = start(module, *arguments)
        if module.endswith("loop.process"):
            os.kill(process.pid, signal.SIGSTOP)
        return process

    def reload() -> None:
        monkeypatch.setattr(processes, "start", start_held)
        with ThreadPoolExecutor(1) as beside:
            first = beside.submit(rig.ask, "POST", "reload", {})
            eventually(lambda: len(rig.loops) == 2)
            answers.append(rig.ask("POST", "reload", {}))
            answers.append(rig.ask("POST", "stop", {}))
            assert not first.done()
            os.kill(rig.loops[1].pid, signal.SIGCONT)
            answers.append(first.result())

    assert rig.run(reload)
    assert [answer.status_code for answer in answers] == [409, 200, 200]
    assert "another reload is in progress" in answers[0].text


@pytest.mark.fault("P11")
def test_reload_by_a_signal(rig: Rig, capsys: pytest.CaptureFixture[str]) -> None:
    """SIGHUP reads the file too; its problems are in the log."""

    def reload() -> None:
        configuration(rig.config.parent, rate_hz="25")
        os.kill(os.getpid(), signal.SIGHUP)
        eventually(lambda: len(rig.loops) == 2)
        rig.up()
        configuration(rig.config.parent, rate_hz="0")
        os.kill(os.getpid(), signal.SIGHUP)
        eventually(lambda: "reload refused" in capsys.readouterr().err)

    assert rig.run(reload)


def test_reload_while_the_amplifier_is_lost_is_refused(rig: Rig) -> None:
    """Its voltage is unknown: a new loop would take it for one at rest."""
    answers: list[httpx.Response] = []

    def reload() -> None:
        words = attach(rig.paths.loop_map, writable=True).words
        words[Word.LOOP_STATE] = list(State).index(State.BLIND)
        words[Word.DEVICES_OPEN] = 1
        configuration(rig.config.parent, rate_hz="25")
        answers.append(rig.ask("POST", "reload", {}))

    assert rig.run(reload)
    assert answers[0].status_code == 409
    assert "the amplifier was lost" in answers[0].json()["error"]["what"]
    assert len(rig.loops) == 1


def test_reload_during_a_recording_is_refused(rig: Rig) -> None:
    """The header of a recording has the configuration of all its records."""
    answers: list[httpx.Response] = []

    def reload() -> None:
        rig.ask("POST", "recordings/start", {})
        answers.append(rig.ask("POST", "reload", {}))

    assert rig.run(reload)
    assert answers[0].status_code == 409
    assert "is running" in answers[0].text
