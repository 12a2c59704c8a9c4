"""The socket of a hosted rig."""

import socket
from pathlib import Path

import pytest

from piezod.errors import DeviceError
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.emulator import listening
from piezod_drivers.emulated.options import EmulatedOptions


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of the rig's socket."""
    return tmp_path / "rig.sock"


def test_socket_of_a_dead_rig_is_replaced(path: Path) -> None:
    """The socket of a killed rig is replaced."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as left:
        left.bind(str(path))

    with listening(path) as listener:
        assert listener.getsockname() == str(path)


def test_only_the_user_may_use_the_rig(path: Path) -> None:
    """Only the owner may use the socket, and it is removed afterwards."""
    with listening(path):
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()


@pytest.mark.parametrize("socket_option", ["rig.sock", "/run/lab/rig.sock"])
def test_socket_may_be_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, socket_option: str
) -> None:
    """A name is a socket in the user's own folder; an absolute path is used unchanged."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    expected = tmp_path / "piezod" / "rig.sock" if socket_option == "rig.sock" else socket_option

    with pytest.raises(DeviceError, match=f"no rig at {expected}:"):
        EmulatedRig(EmulatedOptions(socket=socket_option), ("x",)).open()
