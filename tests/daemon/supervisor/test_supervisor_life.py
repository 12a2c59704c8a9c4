"""A stage from its start to its end, with real processes."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Reaction
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import SHIPPED, UP_WITHIN_S, StartedDaemon, configuration, is_alive
from tests.daemon.hosted_stage import SAFE_V, HostedStage
from tests.daemon.locks import is_held
from tests.daemon.waiting import eventually
from tests.hosted_rig import hosted

RAMP_V_PER_S = 50.0
EXCITATION = {"kind": "sine", "low": 0.0, "high": 50.0, "frequency_hz": 0.1}


@pytest.fixture
def stage(start: StartDaemon, tmp_path: Path) -> Iterator[HostedStage]:
    """Return a stage that is up, with a rig that records each voltage."""
    with hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"):
        yield HostedStage(tmp_path, start, RAMP_V_PER_S)


def arrived(status: dict[str, Any]) -> bool:
    """Return whether the movement to 12.5 µm has ended on target."""
    axis = status["axes"]["x"]
    return bool(axis["on_target"] and abs(axis["position_um"] - 12.5) < 0.2)


def test_stage_is_driven_to_a_position_and_back(start: StartDaemon, rig_file: Path) -> None:
    """An armed stage reaches its position, and an orderly end removes the files of the run."""
    daemon = start(rig_file).up()
    daemon.do("mode", mode="adaptive")
    status = daemon.moving("goto", {"position_um": 12.5}, arrived)
    assert (status["state"], status["mode"]) == ("RUN", "adaptive")

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 0
    assert not daemon.paths.running.exists()
    assert not daemon.paths.api_socket.exists()
    assert not daemon.paths.loop_map.exists()


@pytest.mark.parametrize(
    ("state", "verbs"),
    [
        pytest.param("READY", ("arm",), marks=pytest.mark.stress),
        ("RUN", ("arm", "goto")),
        pytest.param("HOLD", ("arm", "goto", "hold"), marks=pytest.mark.stress),
        pytest.param("RAMP", ("arm", "goto", "stop"), marks=pytest.mark.stress),
        ("ESTOP", ("arm", "goto", "estop")),
        pytest.param("FAULT", ("arm", "estop"), marks=pytest.mark.stress),
        pytest.param("IDENT", ("arm", "identify"), marks=pytest.mark.stress),
    ],
)
@pytest.mark.fault("P1")
def test_end_is_orderly_in_every_state(
    stage: HostedStage, state: str, verbs: tuple[str, ...], reaction: Reaction
) -> None:
    """SIGTERM ends the daemon with code 0 once it was armed; further signals change nothing.

    The last voltage is the safe one.
    """
    daemon = stage.daemon
    for verb in verbs:
        if verb == "goto":
            daemon.driven(20.0, above_v=60.0)
        elif verb == "identify":
            daemon.do(verb, drive_v={"x": EXCITATION}, duration_s=600.0)
        else:
            daemon.do(verb)
    drive_v = daemon.until(state)["axes"]["x"]["drive_v"]
    loop_pid, began_s = daemon.loop_pid, time.monotonic()

    daemon.signal(signal.SIGTERM)
    daemon.signal(signal.SIGINT)

    assert daemon.exit_code() == 0
    reaction("P1", ms=(time.monotonic() - began_s - abs(drive_v - SAFE_V) / RAMP_V_PER_S) * 1e3)
    assert stage.writes()[-1].drive_v == SAFE_V
    assert not is_alive(loop_pid)
    assert not daemon.paths.running.exists()


@pytest.mark.stress
@pytest.mark.fault("P1")
def test_end_is_orderly_before_it_is_armed(start: StartDaemon, rig_file: Path) -> None:
    """A stage at its safe voltage has nothing to ramp down."""
    daemon = start(rig_file).up()
    loop_pid = daemon.loop_pid

    daemon.signal(signal.SIGTERM)
    daemon.signal(signal.SIGINT)

    assert daemon.exit_code() == 0
    assert not is_alive(loop_pid)
    assert not daemon.paths.running.exists()


@pytest.mark.parametrize(
    "sign_of_life",
    [
        "lock",
        pytest.param("running", marks=pytest.mark.stress),
        pytest.param("api_socket", marks=pytest.mark.stress),
        "loop_map",
    ],
)
@pytest.mark.fault("P1")
def test_end_is_orderly_while_it_starts(
    start: StartDaemon, rig_file: Path, sign_of_life: str
) -> None:
    """SIGTERM ends the daemon with code 0 at every moment of its start, and leaves no process."""
    daemon = start(rig_file)
    eventually(getattr(daemon.paths, sign_of_life).exists)
    loop_pid = daemon.loop_pid

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 0, daemon.text
    assert not (loop_pid and is_alive(loop_pid))
    assert not daemon.paths.running.exists()
    assert not daemon.paths.api_socket.exists()


@pytest.mark.fault("P1")
def test_end_is_orderly_while_an_earlier_run_is_ramped_down(
    start: StartDaemon, tmp_path: Path
) -> None:
    """The daemon waits for the ramp, and the mark stays for the next start.

    The ramp is slow enough for a test that polls to see it.
    """
    daemon = start(configuration(tmp_path, safety="{safe_v: 40, ramp_v_per_s: 40}"))
    daemon.signal(signal.SIGKILL)
    daemon.exit_code()
    daemon.paths.make_folders()
    daemon.paths.running.touch()
    daemon.start()
    eventually(lambda: is_held(daemon.paths.loop_lock))

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 0, daemon.text
    assert "ramped down" in daemon.text
    assert daemon.paths.running.exists()


@pytest.mark.fault("P1")
def test_end_is_orderly_without_a_device(start: StartDaemon, tmp_path: Path) -> None:
    """A stage that is BLIND from the start has nothing to ramp down."""
    path = configuration(tmp_path, rig="{driver: emulated, options: {socket: nobody.sock}}")
    daemon = start(path)
    daemon.until("BLIND", UP_WITHIN_S)

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 0
    assert not daemon.paths.running.exists()


@pytest.mark.stress
@pytest.mark.fault("P1")
def test_end_without_the_device_that_was_driven_fails(start: StartDaemon, tmp_path: Path) -> None:
    """The last words say that the voltage is UNKNOWN and which one stays; the exit code is 74."""
    rig = f"{{driver: emulated, options: {{socket: {tmp_path}/rig.sock, deadline_ms: 500}}}}"
    path = configuration(tmp_path, rig=rig)
    with hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"):
        daemon = start(path).up()
        daemon.do("arm")
        daemon.do("goto", position_um=10.0)
    daemon.until("BLIND")

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 74
    assert "UNKNOWN" in daemon.text.splitlines()[-1]
    assert "the voltage stays at" in daemon.text.splitlines()[-1]
    assert daemon.paths.running.exists()


def test_shipped_configuration_runs() -> None:
    """The shipped example runs from any folder, and a shutdown request ends it like SIGTERM."""
    with StartedDaemon(SHIPPED) as daemon:
        daemon.up()
        name = daemon.status()["stage"]

        daemon.do("shutdown")

        assert name == "simulated"
        assert daemon.exit_code() == 0


@pytest.mark.fault("P10")
def test_bad_configuration_starts_nothing(start: StartDaemon, tmp_path: Path) -> None:
    """The exit code is 78, every mistake has its place, and no loop or device was started."""
    daemon = start(configuration(tmp_path, rate_hz="0", speed_um_per_s="fast"))

    assert daemon.exit_code() == 78
    assert "rig.yaml:" in daemon.text
    assert "rate_hz: out of range" in daemon.text
    assert "axes.x.speed_um_per_s: must be a number" in daemon.text
    assert not daemon.paths.loop_map.exists()
    assert not daemon.paths.running.exists()
