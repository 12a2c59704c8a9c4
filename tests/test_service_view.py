"""What a service sees, and who else may change a file."""

import grp
from pathlib import Path

import pytest

from piezod.cli.daemon.shipped import shipped
from piezod.service_view import HIDDEN, service_hint, who_may_change, why_hidden, why_unreachable


@pytest.mark.parametrize("unit", sorted(each.name for each in shipped("systemd").glob("*.service")))
def test_units_hide_what_the_checks_say(unit: str) -> None:
    """The settings that hide folders are those of each unit."""
    lines = (shipped("systemd") / unit).read_text(encoding="utf-8").splitlines()

    assert {f"{setting}=yes" for setting in HIDDEN.values()} <= set(lines)


@pytest.mark.parametrize("folder", HIDDEN)
def test_hidden_folders_are_out_of_reach(folder: Path) -> None:
    """Also by a path that only passes through one."""
    assert str(folder) in why_hidden(folder / "user" / "file")
    assert str(folder) in why_unreachable(folder / "user" / ".." / "file")


def test_link_through_a_hidden_folder_is_out_of_reach(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Either end of a link may be hidden: the link itself, or what it leads to."""
    hidden, seen = tmp_path / "home", tmp_path / "opt"
    for folder in (hidden, seen):
        folder.mkdir()
        (folder / "file").touch()
    monkeypatch.setattr("piezod.service_view.HIDDEN", {hidden: "ProtectHome"})
    (hidden / "link").symlink_to(seen / "file")
    (seen / "link").symlink_to("../home/file")

    assert [bool(why_hidden(each / "link")) for each in (hidden, seen)] == [True, True]
    assert why_hidden(seen / "file") == ""


def test_hint_is_for_services() -> None:
    """A user in a shell sees all folders."""
    path = Path("/home/olga/labpc.crt")

    assert service_hint(path, {}) == ""
    assert "/etc/piezod" in service_hint(path, {"RUNTIME_DIRECTORY": "/run/piezod-web"})


@pytest.mark.parametrize(
    ("mode", "members", "told"),
    [(0o644, ["eve"], 0), (0o664, ["eve"], 1), (0o664, [], 0), (0o646, [], 1)],
)
def test_file_that_others_may_change_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, members: list[str], told: int
) -> None:
    """Every user, or another member of the group of the file."""
    group = grp.struct_group(("lab", "x", 7, members))
    monkeypatch.setattr(grp, "getgrgid", lambda _: group)
    file = tmp_path / "stage.yaml"
    file.touch()
    file.chmod(mode)

    assert len(who_may_change(file)) == told


def test_folder_on_the_way_is_told(tmp_path: Path) -> None:
    """Who may write to a folder may replace a file in it; not with the sticky bit, as in /tmp."""
    folder = tmp_path / "shared"
    folder.mkdir()
    (folder / "stage.yaml").touch()
    folder.chmod(0o777)
    opened = who_may_change(folder / "stage.yaml")
    folder.chmod(0o1777)

    assert (len(opened), who_may_change(folder / "stage.yaml")) == (1, ())
    assert f"chmod o-w {folder}" in opened[0]
