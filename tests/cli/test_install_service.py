"""`piezod install-service`: written files, and refusals."""

import grp
import json
import os
import stat
import sys
from pathlib import Path

import pytest

from piezod.cli.daemon.shipped import shipped
from piezod.daemon import service_files
from piezod.daemon.service_files import TARGETS
from piezod.service_view import why_hidden, why_unreachable
from tests.cli.conftest import Command

COMMAND = "/opt/piezod/bin/piezod"


def install(piezod: Command, root: Path, *arguments: str) -> dict[str, list[str]]:
    """Install below a root; return the document."""
    code, out, err = piezod("install-service", "--root", root, "--json", *arguments)
    assert (code, err) == (0, "")
    document: dict[str, list[str]] = json.loads(out)
    return document


def test_files_are_where_systemd_looks(piezod: Command, folder: Path) -> None:
    """Unit, rules, users and folders are in the places of a Debian package, readable for all."""
    document = install(piezod, folder, "--piezod", COMMAND)

    assert document["written"] == [str(folder / target) for target in TARGETS.values()]
    assert sorted(map(str, TARGETS.values())) == [
        "usr/lib/systemd/system/piezod-ioc.service",
        "usr/lib/systemd/system/piezod-web.service",
        "usr/lib/systemd/system/piezod@.service",
        "usr/lib/sysusers.d/piezod.conf",
        "usr/lib/tmpfiles.d/piezod.conf",
        "usr/lib/udev/rules.d/70-piezod.rules",
    ]
    modes = {stat.S_IMODE((folder / target).stat().st_mode) for target in TARGETS.values()}
    assert modes == {0o644}


def test_unit_runs_the_command_that_was_named(piezod: Command, folder: Path) -> None:
    """The daemon and the ramp-down after it use the given command."""
    install(piezod, folder, "--piezod", COMMAND)
    unit = (folder / TARGETS["piezod@.service"]).read_text()

    assert f"\nExecStart={COMMAND} run /etc/piezod/%i.yaml\n" in unit
    assert f"\nExecStopPost={COMMAND} safe /etc/piezod/%i.yaml --unless-clean\n" in unit
    assert "/usr/bin/piezod" not in unit
    for verb in ("web", "ioc"):
        other = (folder / TARGETS[f"piezod-{verb}.service"]).read_text()
        assert f"\nExecStart={COMMAND} {verb}\n" in other
        assert "/usr/bin/piezod" not in other


def test_unit_runs_this_command_by_default(piezod: Command, folder: Path) -> None:
    """The default command is the one beside the interpreter."""
    if why := why_hidden(Path(sys.executable).parent / "piezod"):
        pytest.skip(f"this checkout is where no service sees it: {why}")
    install(piezod, folder)
    unit = (folder / TARGETS["piezod@.service"]).read_text()

    assert f"\nExecStart={Path(sys.executable).parent}/piezod run " in unit


def test_next_commands_are_printed(piezod: Command, folder: Path) -> None:
    """The text lists every command up to a running stage."""
    code, out, _ = piezod("install-service", "--root", folder, "--piezod", COMMAND)

    assert code == 0
    for command in ("systemd-sysusers", "udevadm", "daemon-reload", "enable --now piezod@"):
        assert command in out


def test_an_earlier_version_is_replaced(piezod: Command, folder: Path) -> None:
    """A second installation replaces the first."""
    install(piezod, folder, "--piezod", "/opt/old/bin/piezod")
    install(piezod, folder, "--piezod", COMMAND)

    assert "/opt/old" not in (folder / TARGETS["piezod@.service"]).read_text()


def test_uninstall_leaves_nothing(piezod: Command, folder: Path) -> None:
    """The installed files and no others are removed; a second removal is no error."""
    other = folder / "usr/lib/systemd/system/other.service"
    install(piezod, folder, "--piezod", COMMAND)
    other.write_text("")
    document = install(piezod, folder, "--uninstall")

    assert document["removed"] == [str(folder / target) for target in TARGETS.values()]
    assert [path for path in folder.rglob("*") if path.is_file()] == [other]
    assert install(piezod, folder, "--uninstall")["removed"] == []


def test_only_root_installs_on_the_machine(
    piezod: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without root the exit code is 77, and the text has a remedy."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    code, _, err = piezod("install-service")

    assert code == 77
    assert "sudo" in err
    assert "--root" in err


@pytest.mark.parametrize("command", ["bin/piezod", "/opt/my piezod", "/opt/%i/piezod", "/a;b"])
def test_command_that_no_unit_can_have(piezod: Command, folder: Path, command: str) -> None:
    """A path with a special meaning for systemd is wrong usage."""
    code, _, err = piezod("install-service", "--root", folder, "--piezod", command)

    assert code == 2
    assert "--piezod" in err
    assert list(folder.iterdir()) == []


def test_command_that_does_not_exist(piezod: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command is checked before anything is written."""
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    code, _, err = piezod("install-service", "--piezod", "/no/such/piezod")

    assert code == 2
    assert "no such file (got /no/such/piezod)" in err


def test_interpreter_that_the_service_cannot_reach(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script with an unreachable interpreter is refused, with a remedy."""
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    closed = {Path("/opt/python"): "closed"}
    monkeypatch.setattr(
        "piezod.cli.daemon.install_service.why_unreachable", lambda path: closed.get(path, "")
    )
    monkeypatch.setattr(service_files, "check_command", lambda _: None)  # it is in /tmp
    script = folder / "piezod"
    script.write_text("#!/opt/python -I\n")
    code, _, err = piezod("install-service", "--piezod", script)

    assert code == 2
    assert "/opt/python: closed; install piezod elsewhere: python3 -m venv /opt/piezod" in err


def test_command_that_everybody_can_run(piezod: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without --root the files are written below /."""
    asked: list[tuple[object, ...]] = []

    def install(*given: object) -> list[Path]:
        asked.append(given)
        return []

    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(service_files, "install", install)
    code, _, err = piezod("install-service", "--piezod", "/usr/bin/env")

    assert (code, err) == (0, "")
    assert asked == [(shipped("systemd"), Path("/"), Path("/usr/bin/env"))]


def test_command_that_is_not_found(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a command beside the interpreter, --piezod is required."""
    monkeypatch.setattr("shutil.which", lambda *_args, **_options: None)
    code, _, err = piezod("install-service", "--root", folder)

    assert code == 2
    assert "--piezod" in err


@pytest.mark.parametrize("path", ["/root/piezod", "/home/olga/.local/bin/piezod", "/var/tmp/p"])  # noqa: S108
def test_command_that_the_unit_hides_is_refused(piezod: Command, folder: Path, path: str) -> None:
    """The unit could not start, also one that is written for a package."""
    code, _, err = piezod("install-service", "--root", folder, "--piezod", path)

    assert code == 2
    assert "the service sees nothing below" in err
    assert list(folder.iterdir()) == []


def test_command_that_everybody_can_run_is_reachable() -> None:
    """A file is reachable if all its folders are open to all users."""
    assert why_unreachable(Path("/usr/bin/env")) == ""


@pytest.mark.parametrize(
    ("present", "group"), [(["dialout", "uucp"], "dialout"), (["uucp"], "uucp"), ([], "dialout")]
)
def test_user_of_the_service_gets_the_group_of_the_serial_ports(
    piezod: Command,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    present: list[str],
    group: str,
) -> None:
    """The group has another name on some systems, and must not be made beside it."""
    found = [grp.struct_group((name, "x", 20, [])) for name in present]
    monkeypatch.setattr(grp, "getgrall", lambda: found)
    install(piezod, folder, "--piezod", COMMAND)

    lines = (folder / TARGETS["piezod.sysusers"]).read_text().splitlines()
    assert [line for line in lines if line.startswith("m ")] == [f"m piezod {group}"]


def test_uninstall_is_refused_while_something_runs(
    piezod: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without its unit a running stage would not be ramped down after a failure."""
    systemctl = tmp_path / "systemctl"
    systemctl.write_text(
        "#!/bin/sh\ncase \"$*\" in *'piezod@*.service'*)\n"
        "    echo piezod@a.service loaded active running piezo stage a\nesac\n"
        'case "$*" in *piezod-web.service*)\n'
        "    echo piezod-web.service loaded active running page of the piezo stages\nesac\n"
    )
    systemctl.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    removed: list[Path] = []
    monkeypatch.setattr(service_files, "uninstall", removed.append)

    code, out, err = piezod("install-service", "--uninstall")

    assert (code, out, removed) == (1, "", [])
    running = "piezod@a.service, piezod-web.service still running or enabled"
    assert f"{running}: `systemctl disable --now piezod@a.service piezod-web.service`" in err


def test_machine_without_systemd_runs_no_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `systemctl` there is nothing to stop."""
    monkeypatch.setenv("PATH", "")

    assert service_files.units_in_use() == []


def test_unit_that_starts_with_the_machine_is_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage that is enabled and stopped counts, and one that also runs counts once."""
    systemctl = tmp_path / "systemctl"
    systemctl.write_text("#!/bin/sh\necho piezod@b.service loaded active running piezo stage b\n")
    systemctl.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    wants = tmp_path / "multi-user.target.wants"
    wants.mkdir()
    for name in ("piezod@a.service", "piezod@b.service", "piezod-web.service", "piezod-x.service"):
        (wants / name).symlink_to("/nonexistent")

    expected = ["piezod@b.service", "piezod-web.service", "piezod@a.service"]
    assert service_files.units_in_use(tmp_path) == expected
