"""A stage from its start to its end, as processes."""

import signal
from pathlib import Path

import pytest

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import SHIPPED, configuration, is_alive
from tests.daemon.waiting import eventually


def test_stage_is_driven_to_a_position_and_back(start: StartDaemon, rig_file: Path) -> None:
    """Armed and told where to go it is there in the end, and an orderly end leaves no trace."""
    daemon = start(rig_file).up()
    assert daemon.do("arm")["accepted"]
    daemon.do("mode", mode="adaptive")
    motion = daemon.do("goto", position_um=12.5)["motion"]

    def arrived() -> bool:
        axis = daemon.status()["axes"]["x"]
        return bool(axis["on_target"] and axis["motion"] == motion)

    eventually(arrived)
    status = daemon.status()
    assert (status["state"], status["mode"]) == ("RUN", "adaptive")
    assert status["axes"]["x"]["position_um"] == pytest.approx(12.5, abs=0.2)

    daemon.signal(signal.SIGTERM)

    assert daemon.exit_code() == 0
    assert not daemon.paths.running.exists()
    assert not daemon.paths.api_socket.exists()
    assert not daemon.paths.loop_map.exists()


@pytest.mark.parametrize(
    ("state", "verbs"),
    [
        pytest.param("SAFE", (), marks=pytest.mark.stress),
        pytest.param("READY", ("arm",), marks=pytest.mark.stress),
        ("RUN", ("arm", "goto")),
        ("HOLD", ("arm", "goto", "hold")),
        pytest.param("RAMP", ("arm", "goto", "stop"), marks=pytest.mark.stress),
        ("ESTOP", ("arm", "goto", "estop")),
        pytest.param("FAULT", ("arm", "estop"), marks=pytest.mark.stress),
    ],
)
@pytest.mark.fault("P1")
def test_end_is_orderly_in_every_state(
    start: StartDaemon, rig_file: Path, state: str, verbs: tuple[str, ...]
) -> None:
    """SIGTERM ends it with 0 whatever it does; further signals change nothing."""
    daemon = start(rig_file).up()
    for verb in verbs:
        if verb == "goto":
            daemon.do(verb, position_um=20.0)
            eventually(lambda: daemon.status()["axes"]["x"]["drive_v"] > 60)
        else:
            daemon.do(verb)
    daemon.until(state)
    loop_pid = daemon.loop_pid

    daemon.signal(signal.SIGTERM)
    daemon.signal(signal.SIGINT)

    assert daemon.exit_code() == 0
    assert not is_alive(loop_pid)
    assert not daemon.paths.running.exists()


def test_shipped_configuration_runs(start: StartDaemon) -> None:
    """What the README starts with works from anywhere."""
    daemon = start(SHIPPED).up()

    assert daemon.status()["stage"] == "simulated"


def test_engineer_may_end_it(start: StartDaemon, rig_file: Path) -> None:
    """A request to shut down does what SIGTERM does."""
    daemon = start(rig_file).up()
    daemon.do("arm")

    daemon.do("shutdown")

    assert daemon.exit_code() == 0


@pytest.mark.fault("P9")
def test_second_start_leaves_the_first_alone(start: StartDaemon, rig_file: Path) -> None:
    """Whoever comes second ends with 75 and has touched nothing, however many come at once."""
    daemon = start(rig_file).up()
    pid = daemon.loop_pid
    before = daemon.paths.api_socket.stat()
    lock = daemon.paths.lock.read_text()
    others = [daemon.another() for _ in range(2)]

    codes = [other.wait() for other in others]

    assert codes == [75, 75]
    assert daemon.until("SAFE")["stage"] == "rig"
    assert (daemon.loop_pid, daemon.paths.lock.read_text()) == (pid, lock)
    assert daemon.paths.api_socket.stat() == before
    assert daemon.paths.running.exists()


@pytest.mark.fault("P10")
def test_bad_configuration_starts_nothing(start: StartDaemon, tmp_path: Path) -> None:
    """It ends with 78, every mistake with its place, and no device or loop was started."""
    daemon = start(configuration(tmp_path, rate_hz="0", speed_um_per_s="fast"))

    assert daemon.exit_code() == 78
    assert "rig.yaml:" in daemon.text
    assert "rate_hz: out of range" in daemon.text
    assert "axes.x.speed_um_per_s: must be a number" in daemon.text
    assert not daemon.paths.loop_map.exists()
    assert not daemon.paths.running.exists()
