"""Several daemons on one machine: they begin together, and none disturbs another."""

import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.client import Arrival, StageGroup
from piezod.client.listing import list_stages
from piezod.errors import GroupError
from piezod.units import NS_PER_S
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import Daemon, configuration, is_alive, latched
from tests.daemon.waiting import eventually

# `make test` has the same with fakes and in virtual time: tests/client/test_stage_group.py and
# test_group_wait.py, tests/control/stage/test_common_start.py.
pytestmark = pytest.mark.stress

RISE = {"kind": "triangle", "low": 2.0, "high": 12.0, "frequency_hz": 0.5}
NAMES = ("fast", "slow", "spare")
PAIR = ("fast", "slow")
Daemons = dict[str, Daemon]


@pytest.fixture
def daemons(
    tmp_path: Path, start: StartDaemon, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Daemons]:
    """Return three running daemons of other rates, which clients of this process find."""
    folder = tempfile.mkdtemp(prefix="pz-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    found = {}
    for name, rate_hz in zip(NAMES, (100, 70, 50), strict=True):
        config = configuration(tmp_path, rate_hz=str(rate_hz)).rename(tmp_path / f"{name}.yaml")
        found[name] = start(config, XDG_RUNTIME_DIR=folder, XDG_STATE_HOME=folder)
    for daemon in found.values():
        daemon.up()
    yield found
    shutil.rmtree(folder, ignore_errors=True)


def departure_s(file: Path) -> tuple[float, float]:
    """Return the last instant with the command at the start of the rise, and the next one.

    Both are of cycles, in s of the machine's clock.
    """
    with h5py.File(file, "r") as opened:
        entry = opened["recording"]
        t_s = entry["cycles/t_s"][:] + entry.attrs["start_ns"] / NS_PER_S
        command_um = entry["axis_x/command_um"][:]
    at_start = int(np.flatnonzero(np.abs(command_um - RISE["low"]) < 1e-9)[-1])
    return float(t_s[at_start]), float(t_s[at_start + 1])


def test_waveforms_begin_within_one_period(daemons: Daemons, tmp_path: Path) -> None:
    """In the recordings both loops leave the start of the waveform at the common instant."""
    for stage in PAIR:
        daemons[stage].moving("goto", {"position_um": 5.0})
    leaves = {}
    with StageGroup(PAIR) as group:
        recordings = group.start_recording("common")
        started = group.wave({stage: {"x": RISE} for stage in PAIR}, 1.0, start_in_s=3.0)
        for stage, answer in started.answers.items():
            daemons[stage].moving("goto", {}, lambda now: now["axes"]["x"]["on_target"])
            assert group.status()[stage].axes["x"].motion == answer.motion
        group.stop_recording()
        for stage, recording in recordings.items():
            file = tmp_path / f"{stage}.h5"
            group.client(stage).fetch_recording(recording.name, file)
            leaves[stage] = departure_s(file)

    for stage, (last_s, next_s) in leaves.items():
        print(
            f"{stage}: the first cycle on its way is {1e3 * (next_s - started.start_s):.3f} ms late"
        )
        assert last_s <= started.start_s < next_s
    print(f"difference: {1e3 * abs(leaves['fast'][1] - leaves['slow'][1]):.3f} ms")


def arriving(daemons: Daemons, position_um: float) -> dict[str, tuple[Arrival, ...]]:
    """Move two stages, and wait until both have arrived; repeat it if late cycles stop one."""
    for _ in range(5):
        for name in PAIR:
            daemons[name].moving("goto", {"position_um": 5.0})
        try:
            with StageGroup(PAIR) as group:
                return group.goto_and_wait({stage: {"x": position_um} for stage in PAIR})
        except GroupError as error:
            print(error)
    raise AssertionError(daemons["fast"].text)


def test_the_wait_ends_when_both_stages_are_on_target(daemons: Daemons) -> None:
    """Then each daemon says so itself."""
    arrived = arriving(daemons, 9.0)

    for name in PAIR:
        assert arrived[name][0].position_um == pytest.approx(9.0, abs=1.0)
        assert daemons[name].status()["axes"]["x"]["target_um"] == 9.0


# httpcore closes no socket that cannot be connected.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("loss", ["estop", "hold", "loop", "supervisor"])
def test_a_stage_that_is_lost_in_a_movement_lets_the_other_hold(
    daemons: Daemons, loss: str
) -> None:
    """A fault, a hold of somebody else, and the end of a process: the other one stands still."""
    victim, long = daemons["slow"], {"kind": "sine", "low": 4.0, "high": 8.0, "frequency_hz": 1.0}
    for name in PAIR:
        daemons[name].moving("goto", {"position_um": 5.0})
    with StageGroup(PAIR) as group, ThreadPoolExecutor(1) as threads:
        started = group.wave({stage: {"x": long} for stage in PAIR}, 600.0, start_in_s=3.0)
        waiting = threads.submit(group.wait, started)
        eventually(lambda: daemons["fast"].status()["lease"])
        if loss == "loop":
            os.kill(victim.loop_pid, signal.SIGKILL)
        elif loss == "supervisor":
            victim.signal(signal.SIGKILL)
        else:
            victim.do(loss)
        with pytest.raises(GroupError, match=r"slow: .*fast held"):
            waiting.result(60.0)
        del waiting
        gc.collect()

    assert daemons["fast"].until("HOLD")["axes"]["x"]["motion"] > 0


@pytest.mark.parametrize("victim", ["loop", "supervisor", "both"])
def test_killed_stage_disturbs_no_other(daemons: Daemons, victim: str) -> None:
    """The others keep their movements; the list and the group name the one that is missing."""
    others = {name: daemon for name, daemon in daemons.items() if name != "spare"}
    wave = {"command_um": {"x": RISE}, "duration_s": 600.0}
    for daemon in daemons.values():
        daemon.moving("wave", wave)
    before = {name: (each.loop_pid, _motion(each)) for name, each in others.items()}
    loop_pid = daemons["spare"].loop_pid
    if victim != "supervisor":
        os.kill(loop_pid, signal.SIGKILL)
    if victim != "loop":
        daemons["spare"].signal(signal.SIGKILL)
    daemons["spare"].exit_code()
    eventually(lambda: not is_alive(loop_pid), 60.0)

    for name, daemon in others.items():
        status = daemon.until("RUN")
        assert (daemon.loop_pid, _motion(daemon)) == before[name]
        assert latched(status) == []
    assert [each.name for each in list_stages()] == sorted(others)
    with StageGroup(NAMES) as group:
        with pytest.raises(GroupError, match=r"arm failed on spare: .*\(nothing was changed\)"):
            group.arm()
        with pytest.raises(GroupError, match=r"stop failed on spare: .*\(done on fast, slow\)"):
            group.stop()
    for daemon in others.values():
        daemon.until("SAFE")


def test_stage_that_hangs_delays_no_emergency_stop(daemons: Daemons) -> None:
    """The others stop at once; the loop of the hung daemon ramps down by itself."""
    for daemon in daemons.values():
        daemon.moving("wave", {"command_um": {"x": RISE}, "duration_s": 600.0})
    hung = daemons["spare"]
    loop_pid = hung.loop_pid
    hung.signal(signal.SIGSTOP)
    with (
        StageGroup(NAMES) as group,
        pytest.raises(GroupError, match=r"estop failed on spare: .* not answer .*on fast, slow\)"),
    ):
        group.estop()
    ended = eventually(lambda: not is_alive(loop_pid), 60.0)
    hung.signal(signal.SIGCONT)

    assert ended
    for name in ("fast", "slow"):
        assert "E1" in latched(daemons[name].until("FAULT"))


def _motion(daemon: Daemon) -> int:
    motion: int = daemon.status()["axes"]["x"]["motion"]
    return motion
