"""The service under a real systemd, booted in a container: its start, its use, its failures."""

from collections.abc import Iterator

import pytest

from tests.daemon.waiting import eventually
from tests.system.installed_stage import (
    CONFIG,
    OUTSIDER,
    RAMP_V_PER_S,
    SAFE_V,
    TARGET_UM,
    UNIT,
    InstalledStage,
    fastest_v_per_s,
)
from tests.system.machine import PIEZOD, Machine, build_wheel, why_not

pytestmark = [
    pytest.mark.stress,
    pytest.mark.timeout(300),  # the first test boots, and compiles the kernels
    pytest.mark.skipif(bool(why_not()), reason=why_not()),
]

DIRECTORIES = "RUNTIME_DIRECTORY=/run/piezod/stage1 STATE_DIRECTORY=/var/lib/piezod/stage1"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InstalledStage]:
    """Return the stage on a machine that boots once."""
    folder = tmp_path_factory.mktemp("machine")
    with Machine(build_wheel(folder), folder / "console.log") as machine:
        yield InstalledStage(machine)


@pytest.fixture
def stage(installed: InstalledStage) -> Iterator[InstalledStage]:
    """Return the stage; a failing test prints its journal."""
    yield installed
    print(installed.log())


def test_operator_moves_the_stage(stage: InstalledStage) -> None:
    """After the start an operator arms the stage and moves it to its target."""
    stage.begin_driven()

    axis = stage.status()["axes"]["x"]
    assert stage.shows("ActiveState") == "active"
    assert axis["command_um"] == TARGET_UM
    assert axis["position_um"] == pytest.approx(TARGET_UM, abs=0.5)


def test_others_are_kept_out(stage: InstalledStage) -> None:
    """A user in none of the groups gets exit code 77 and cannot read the files."""
    stage.begin()
    refused = stage.piezod("arm", OUTSIDER)

    assert refused.returncode == 77
    assert "become a member of the group" in refused.stderr
    assert stage.machine.run("cat /run/piezod/stage1/lock", OUTSIDER).returncode == 1
    assert stage.machine.run("ls /var/lib/piezod/stage1", OUTSIDER).returncode == 2


def test_stop_ends_at_the_safe_voltage(stage: InstalledStage) -> None:
    """`systemctl stop` ramps gently, exits with 0 and leaves no mark of an unclean end."""
    stage.begin_driven()
    before = len(stage.writes())
    stage.machine.root(f"systemctl stop {UNIT}")

    ramp = stage.writes()[before:]
    assert (stage.shows("Result"), stage.shows("ExecMainStatus")) == ("success", "0")
    assert ramp[-1].drive_v == SAFE_V
    assert fastest_v_per_s(ramp) <= 1.5 * RAMP_V_PER_S
    assert stage.machine.run("test -e /var/lib/piezod/stage1/running").returncode == 1


@pytest.mark.fault("P2")
@pytest.mark.parametrize(
    ("signal", "victim", "result"),
    [
        ("STOP", "loop", "exit-code"),  # the supervisor ends it, and then itself
        ("STOP", "supervisor", "watchdog"),
        ("STOP", "both", "watchdog"),
        ("KILL", "supervisor", "signal"),
        ("KILL", "both", "signal"),
    ],
)
def test_hung_or_killed_service_ramps_down(
    stage: InstalledStage, signal: str, victim: str, result: str
) -> None:
    """A hung or killed service ramps gently to the safe voltage and starts again, in FAULT."""
    stage.begin_driven()
    pids = {"loop": stage.loop, "supervisor": stage.supervisor}
    before = len(stage.writes())
    hit = " ".join(pids.values()) if victim == "both" else pids[victim]
    stage.machine.root(f"kill -{signal} {hit}")
    stage.wait_for_restart()

    ramp = stage.writes()[before:]
    status = stage.status()
    assert ramp[-1].drive_v == SAFE_V
    assert fastest_v_per_s(ramp) <= 1.5 * RAMP_V_PER_S
    assert status["state"] == "FAULT"
    assert "P2" in [fault["id"] for fault in status["faults"]]
    results = [line for line in stage.log().splitlines() if "Failed with result" in line]
    assert results[-1].endswith(f"'{result}'.")


def test_bad_configuration_stays_down(stage: InstalledStage) -> None:
    """After exit code 78 there is no restart, and the journal has the place of the mistake."""
    stage.begin()
    stage.machine.root(f"systemctl stop {UNIT}")
    before = len(stage.writes())
    stage.machine.write(CONFIG, stage.configuration.replace("safe_v: 0", "safe_v: 1000"))
    started = stage.machine.run(f"systemctl start {UNIT}")

    assert started.returncode == 1
    assert (stage.shows("ExecMainStatus"), stage.shows("NRestarts")) == ("78", "0")
    assert stage.shows("ActiveState") == "failed"
    assert f"{CONFIG}:" in stage.log()
    assert len(stage.writes()) == before


def test_second_daemon_leaves_the_first_alone(stage: InstalledStage) -> None:
    """The second daemon ends with 75; the first one holds its position on, as the same process."""
    stage.begin_driven()
    first, before = stage.supervisor, len(stage.writes())
    second = stage.machine.run(
        f"setpriv --reuid=piezod --regid=piezod-view --init-groups "
        f"env {DIRECTORIES} {PIEZOD} run {CONFIG}"
    )

    assert second.returncode == 75
    assert f"process {first}" in second.stderr
    assert stage.supervisor == first
    eventually(lambda: len(stage.writes()) > before)


def test_service_leaves_another_daemon_alone(stage: InstalledStage) -> None:
    """If another process has the lock, the service stays down with 75 and removes no file."""
    stage.begin()
    stage.machine.root(f"systemctl stop {UNIT}")
    lock = "/run/piezod/stage1/lock"
    stage.machine.root(f"systemd-run --unit=other --uid=piezod flock {lock} sleep 600")
    stage.machine.wait_until(f"! flock --nonblock {lock} true")
    started = stage.machine.run(f"systemctl start {UNIT}")
    status = stage.shows("ExecMainStatus"), stage.shows("NRestarts")
    stage.machine.root("systemctl stop other")

    assert started.returncode == 1
    assert status == ("75", "0")
    assert stage.machine.run(f"test -e {lock}").returncode == 0


def test_udev_understands_the_rules(stage: InstalledStage) -> None:
    """Without a complaint of udev, the service's user owns the file that keeps processors awake."""
    device = "/sys/devices/virtual/misc/cpu_dma_latency"
    output = stage.machine.run(f"udevadm test --action=add {device} 2>&1").stdout.splitlines()
    done = [line.split("70-piezod.rules:")[1] for line in output if "70-piezod.rules:" in line]

    user = stage.machine.root("id --user piezod")
    assert [line.partition(" ")[2] for line in done] == [f"OWNER {user}", "MODE 0600"]


def test_reload_keeps_the_service(stage: InstalledStage) -> None:
    """After `systemctl reload` a changed file is in force in the same process."""
    stage.begin()
    first, loop = stage.supervisor, stage.loop
    changed = stage.configuration.replace("speed_um_per_s: 200", "speed_um_per_s: 100")
    stage.machine.write(CONFIG, changed)
    stage.machine.root(f"systemctl reload {UNIT}")
    stage.machine.wait_until(f"! kill -0 {loop}")
    stage.machine.wait_until(f"systemctl --quiet is-active {UNIT}")

    assert stage.supervisor == first
    assert stage.shows("NRestarts") == "0"
