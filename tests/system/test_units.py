"""The installed files, checked by systemd's own tools; nothing is started."""

import shutil
import stat
import subprocess
from pathlib import Path

import pytest

from piezod.cli import exit_codes
from piezod.cli.daemon.shipped import shipped
from piezod.config.daemon import LoopConfig
from piezod.config.hung import HUNG_S
from piezod.daemon import service_files
from piezod.daemon.durations import RAMP_DOWN_PATIENCE_S
from piezod.daemon.supervisor.loop_run import END_GRACE_S

EXPOSURE_AT_MOST = 1.5

with_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed"
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a root below which all files are installed, for a command that exists."""
    command = shutil.which("true")
    assert command is not None
    service_files.install(shipped("systemd"), tmp_path, Path(command))
    return tmp_path


UNITS = ("piezod@.service", "piezod-web.service", "piezod-ioc.service")


def unit(root: Path, name: str = "piezod@.service") -> Path:
    """Return the path of a unit."""
    return root / service_files.TARGETS[name]


def analyse(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run systemd-analyze; the uses here need no running systemd."""
    command = [str(shutil.which("systemd-analyze")), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@with_systemd
@pytest.mark.parametrize("name", UNITS)
def test_verify_has_nothing_to_say(root: Path, name: str) -> None:
    """The unit causes no warning, which systemd prints for an unknown value."""
    ended = analyse("verify", "--man=no", str(unit(root, name)))

    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


@with_systemd
@pytest.mark.parametrize("name", UNITS)
def test_exposure_is_small(root: Path, name: str) -> None:
    """A daemon under foreign control could do little, by systemd's own measure."""
    ended = analyse("security", "--offline=true", "--no-pager", str(unit(root, name)))

    (verdict,) = [line for line in ended.stdout.splitlines() if "exposure level" in line]
    assert float(verdict.split(":")[1].split()[0]) <= EXPOSURE_AT_MOST


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="no systemd-sysusers")
def test_users_and_groups_are_made(root: Path) -> None:
    """The user is in the group of serial ports, and the groups of the three roles exist."""
    definitions = root / service_files.TARGETS["piezod.sysusers"]
    (root / "etc").mkdir()
    command = [str(shutil.which("systemd-sysusers")), f"--root={root}", str(definitions)]
    subprocess.run(command, check=True)

    groups = dict(line.split(":x:") for line in (root / "etc/group").read_text().splitlines())
    assert {"piezod", "piezod-view", "piezod-eng"} <= set(groups)
    assert groups["dialout"].endswith(":piezod")


@pytest.mark.skipif(shutil.which("systemd-tmpfiles") is None, reason="no systemd-tmpfiles")
def test_folders_are_made(root: Path) -> None:
    """Everybody can read the configurations and find the stages; only root can add one."""
    definitions = root / service_files.TARGETS["piezod.tmpfiles"]
    command = [str(shutil.which("systemd-tmpfiles")), "--create", f"--root={root}"]
    subprocess.run([*command, str(definitions)], check=True)

    for folder in ("etc/piezod", "run/piezod"):
        assert stat.S_IMODE((root / folder).stat().st_mode) == 0o755


def section(name: str, file: str = "piezod@.service") -> dict[str, list[str]]:
    """Return all values of each key in a section of a shipped unit."""
    found: dict[str, list[str]] = {}
    here = ""
    for line in (shipped("systemd") / file).read_text().splitlines():
        if line.startswith("["):
            here = line.strip("[]")
        elif here == name and "=" in line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.setdefault(key, []).append(value)
    return found


def test_exit_codes_without_a_restart() -> None:
    """A second daemon, a missing permission and a bad configuration cause no restart."""
    codes = exit_codes.ALREADY_RUNNING, exit_codes.NO_PERMISSION, exit_codes.CONFIGURATION

    assert section("Service")["RestartPreventExitStatus"] == [" ".join(map(str, codes))]


@pytest.mark.fault("P5")
def test_service_that_ends_repeatedly_is_given_up() -> None:
    """Each end ramps the stage down; after three in five minutes somebody must look at it."""
    start, service = section("Unit"), section("Service")

    assert (start["StartLimitBurst"], start["StartLimitIntervalSec"]) == (["3"], ["300"])
    assert service["Restart"] == ["on-failure"]
    assert float(service["RestartSec"][0]) * 3 < 300
    assert service["ExecStopPost"] == ["/usr/bin/piezod safe /etc/piezod/%i.yaml --unless-clean"]


@pytest.mark.fault("P14")
def test_shutdown_of_the_machine_is_a_sigterm() -> None:
    """The unit keeps systemd's defaults: it is stopped before the shutdown, by SIGTERM, in time."""
    unit, service = section("Unit"), section("Service")

    assert not {"DefaultDependencies", "IgnoreOnIsolate", "SurviveFinalKillSignal"} & set(unit)
    assert not {"KillSignal", "KillMode", "SendSIGKILL", "ExecStop"} & set(service)
    assert float(service["TimeoutStopSec"][0]) > END_GRACE_S + RAMP_DOWN_PATIENCE_S


def test_supervisor_has_time_to_end_gently() -> None:
    """The time-outs of the service manager are longer than those of the supervisor."""
    service = section("Service")

    assert float(service["WatchdogSec"][0]) > HUNG_S
    assert float(service["TimeoutStopSec"][0]) > END_GRACE_S + RAMP_DOWN_PATIENCE_S


def test_the_loop_may_become_real_time() -> None:
    """Limits and filters allow it, and the supervisor stays an ordinary process."""
    service = section("Service")

    assert int(service["LimitRTPRIO"][0]) >= LoopConfig().priority
    assert service["LimitMEMLOCK"] == ["infinity"]
    assert "sched_setscheduler" in service["SystemCallFilter"][-1]
    forbidden = {"CPUSchedulingPolicy", "RestrictRealtime", "MemoryDenyWriteExecute"}
    assert not forbidden & set(service)


def test_peers_are_known() -> None:
    """In a user namespace every client would have the same unknown user."""
    assert "PrivateUsers" not in section("Service")


def test_page_has_folders_that_it_can_write() -> None:
    """Its user has no home: token, copies, learned tables and kernels have folders of the unit."""
    service = section("Service", "piezod-web.service")

    for kind in ("Runtime", "Cache", "State"):
        assert service[f"{kind}Directory"] == ["piezod-web"]
    assert service["Environment"] == ["NUMBA_CACHE_DIR=%C/piezod-web/kernels"]
    assert service["ProtectSystem"] == ["strict"]
