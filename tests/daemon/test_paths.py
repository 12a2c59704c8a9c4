"""Paths of a stage's files."""

import os
import tempfile
from pathlib import Path

import pytest

from piezod.daemon.paths import stage_paths
from piezod.errors import ConfigError

CONFIG = Path("config/lab.yaml")


def test_systemd_names_both_folders() -> None:
    """The folders of systemd are used as they are, the first of several."""
    environ = {"RUNTIME_DIRECTORY": "/run/piezod/lab:/run/other", "STATE_DIRECTORY": "/var/lib/p"}

    paths = stage_paths(CONFIG, environ)

    assert (paths.name, paths.api_socket) == ("lab", Path("/run/piezod/lab/api.sock"))
    assert paths.running == Path("/var/lib/p/running")


def test_users_own_folders_have_the_name_of_the_stage() -> None:
    """Without systemd each stage of a user has its own folders."""
    environ = {"XDG_RUNTIME_DIR": "/run/user/7", "XDG_STATE_HOME": "/home/me/state"}

    paths = stage_paths(CONFIG, environ)

    assert paths.lock == Path("/home/me/state/piezod/lab/lock")
    assert paths.audit == Path("/home/me/state/piezod/lab/audit.jsonl")


def test_there_are_folders_without_any_variable() -> None:
    """A relative path in a variable is ignored."""
    paths = stage_paths(CONFIG, {"XDG_RUNTIME_DIR": "here"})

    assert paths.runtime == Path(tempfile.gettempdir()) / f"piezod-{os.getuid()}" / "lab"
    assert paths.state == Path.home() / ".local/state/piezod/lab"


@pytest.mark.parametrize("name", [".yaml", "...yaml", ".."])
def test_file_name_that_is_no_name_of_a_folder_is_refused(name: str) -> None:
    """No configuration leads to files elsewhere."""
    with pytest.raises(ConfigError, match="must not begin with a dot"):
        stage_paths(Path(name), {})


def _in(folder: Path) -> dict[str, str]:
    return {"XDG_RUNTIME_DIR": str(folder), "XDG_STATE_HOME": str(folder / "state")}


@pytest.mark.parametrize("path", [b"st\xfcck.yaml", b"/st\xfcck/stage.yaml"])
def test_path_that_is_no_text_is_refused(path: bytes) -> None:
    """A path that is no UTF-8 could not be stored in the files of the stage; an umlaut can."""
    with pytest.raises(ConfigError, match="rename it"):
        stage_paths(Path(os.fsdecode(path)), {})
    assert stage_paths(Path("stück.yaml"), {}).name == "stück"


def test_folders_are_private(tmp_path: Path) -> None:
    """No other user may enter the folders."""
    paths = stage_paths(CONFIG, _in(tmp_path))

    paths.make_folders()

    assert [each.stat().st_mode & 0o777 for each in (paths.runtime, paths.state)] == [0o700] * 2


def test_folder_that_others_write_to_is_refused(tmp_path: Path) -> None:
    """Other users could put a socket into such a folder."""
    paths = stage_paths(CONFIG, _in(tmp_path))
    paths.make_folders()
    paths.runtime.chmod(0o777)

    with pytest.raises(PermissionError, match="no other user may write to") as caught:
        paths.make_folders()

    assert caught.value.filename == str(paths.runtime)


def test_umask_opens_no_folder(tmp_path: Path) -> None:
    """Under the umask 000 all new folders are private, so that a second start is not refused."""
    paths = stage_paths(CONFIG, _in(tmp_path / "new"))
    before = os.umask(0)
    try:
        paths.make_folders()
        paths.make_folders()
    finally:
        os.umask(before)

    made = [each for each in (tmp_path / "new").rglob("*") if each.is_dir()]
    assert {each.stat().st_mode & 0o777 for each in made} == {0o700}


def test_link_is_refused(tmp_path: Path) -> None:
    """A link instead of the folder may lead anywhere."""
    paths = stage_paths(CONFIG, _in(tmp_path))
    paths.make_folders()
    paths.runtime.rmdir()
    paths.runtime.symlink_to(tmp_path)

    with pytest.raises(PermissionError, match="must be a folder"):
        paths.make_folders()


def test_path_too_long_for_a_socket_is_refused(tmp_path: Path) -> None:
    """The message has the allowed length and a remedy, which that of the socket lacks."""
    paths = stage_paths(CONFIG, _in(tmp_path / ("long" * 30)))

    with pytest.raises(OSError, match=r"allowed: 107 bytes; set XDG_RUNTIME_DIR"):
        paths.make_folders()
