"""The choice of a daemon."""

import errno
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from piezod.client.places import check_socket, find_socket, running_stages
from piezod.errors import AmbiguousStageError, ClientError, NotAllowedError, NotRunningError

Listen = Callable[[Path], Path]


@pytest.fixture
def listen() -> Iterator[Listen]:
    """Return a function that makes the folder of a stage with a listening socket."""
    with ExitStack() as stack:

        def start(folder: Path) -> Path:
            folder.mkdir(parents=True)
            listening = stack.enter_context(socket.socket(socket.AF_UNIX))
            listening.bind(str(folder / "api.sock"))
            listening.listen()
            return folder / "api.sock"

        yield start


@pytest.fixture(autouse=True)
def own_tmp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder for temporary files without other daemons."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_the_only_one_is_meant(tmp_path: Path, listen: Listen) -> None:
    """The only running stage needs no name."""
    path = listen(tmp_path / "r" / "piezod" / "bench")

    assert find_socket(None, {"XDG_RUNTIME_DIR": str(tmp_path / "r")}, tmp_path) == path


def test_one_of_several_is_named(tmp_path: Path, listen: Listen, own_tmp: Path) -> None:
    """A daemon is found by name as a service, of the user, or without a runtime folder."""
    service = listen(tmp_path / "run" / "afm")
    users = listen(tmp_path / "r" / "piezod" / "bench")
    own = listen(own_tmp / f"piezod-{os.getuid()}" / "test")
    environ = {"XDG_RUNTIME_DIR": str(tmp_path / "r")}

    assert running_stages(environ, tmp_path / "run") == {
        "afm": service,
        "bench": users,
        "test": own,
    }
    assert find_socket("afm", environ, tmp_path / "run") == service
    assert find_socket(None, {**environ, "PIEZOD_STAGE": "test"}, tmp_path / "run") == own
    with pytest.raises(AmbiguousStageError, match="afm, bench, test; name one with --stage"):
        find_socket(None, environ, tmp_path / "run")
    with pytest.raises(NotRunningError, match="for stage 'no', running: afm, bench, test; start"):
        find_socket("no", environ, tmp_path / "run")


def test_socket_of_the_environment_is_taken_as_it_is(tmp_path: Path) -> None:
    """PIEZOD_SOCKET applies unless a stage is named."""
    environ = {"PIEZOD_SOCKET": "/a/b.sock"}

    assert find_socket(None, environ, tmp_path) == Path("/a/b.sock")
    with pytest.raises(NotRunningError, match="no daemon is running for stage 'x'"):
        find_socket("x", environ, tmp_path)


def test_address_has_no_socket(tmp_path: Path) -> None:
    """A command that needs the socket takes no stage of another computer."""
    environ = {"PIEZOD_STAGE": "https://labpc:8443"}

    for stage in (None, "https://labpc:8443/stages/bench"):
        with pytest.raises(ClientError, match=r"labpc:8443.*: a stage of this machine is needed"):
            find_socket(stage, environ, tmp_path)


def test_nobody_listens(tmp_path: Path) -> None:
    """The socket of a killed daemon does not count as running."""
    folder = tmp_path / "run" / "killed"
    folder.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX) as gone:
        gone.bind(str(folder / "api.sock"))

    with pytest.raises(NotRunningError, match=r"^no daemon is running; start it"):
        find_socket(None, {}, tmp_path / "run")
    with pytest.raises(NotRunningError, match="no daemon is running there"):
        check_socket(folder / "api.sock")


def test_end_without_order_is_told_with_its_remedy(tmp_path: Path) -> None:
    """A killed daemon may have left a voltage, and no command that needs it ramps that down."""
    environ = {"XDG_STATE_HOME": str(tmp_path)}
    folder = tmp_path / "piezod" / "bench"
    folder.mkdir(parents=True)
    (folder / "running").touch()

    for name in (None, "bench"):
        with pytest.raises(NotRunningError, match=r"'bench' .*`piezod safe CONFIG`"):
            find_socket(name, environ, tmp_path / "run")
    with pytest.raises(NotRunningError) as other:
        find_socket("other", environ, tmp_path / "run")

    assert "piezod safe" not in str(other.value)


def test_path_longer_than_sockets_may_have(tmp_path: Path) -> None:
    """A path that is too long is no running daemon."""
    with pytest.raises(NotRunningError, match="no daemon is running there"):
        check_socket(tmp_path / ("a" * 120))


def test_socket_that_keeps_us_out(
    tmp_path: Path, listen: Listen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A socket without permission counts as running, and the error names the groups."""
    path = listen(tmp_path / "run" / "afm")
    path.chmod(0)
    if os.getuid() == 0:  # root may connect to everything
        monkeypatch.setattr("socket.socket.connect_ex", lambda *_: errno.EACCES)

    assert find_socket("afm", {}, tmp_path / "run") == path
    with pytest.raises(NotAllowedError, match="piezod-view, which opens the socket"):
        check_socket(path)


def test_folder_that_everybody_may_write_to_is_not_trusted(
    tmp_path: Path, listen: Listen, own_tmp: Path
) -> None:
    """A temporary folder that others can write to is ignored."""
    listen(own_tmp / f"piezod-{os.getuid()}" / "test")
    (own_tmp / f"piezod-{os.getuid()}").chmod(0o777)

    assert running_stages({}, tmp_path / "run") == {}


def test_link_is_not_trusted(tmp_path: Path, listen: Listen, own_tmp: Path) -> None:
    """A temporary folder that is a link is ignored."""
    listen(tmp_path / "elsewhere" / "test")
    (own_tmp / f"piezod-{os.getuid()}").symlink_to(tmp_path / "elsewhere")

    assert running_stages({}, tmp_path / "run") == {}
