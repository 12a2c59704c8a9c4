"""Hosts a rig in this process, in real time, until the process is told to end."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from pathlib import Path

from piezod.devices.emulation.trace import Trace
from piezod.devices.interface import Amplifier, Device, Sensor
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.emulated.options import DEFAULT_SOCKET, socket_path
from piezod_drivers.emulated.server import RigServer


def host(
    rig: Device,
    axes: Sequence[str],
    where: Path | None,
    trace: Path | None,
    ready: Callable[[Path], None],
) -> None:
    """Serve a rig at a socket until SIGINT or SIGTERM; to be called in the main thread.

    Args:
        rig: The device, constructed and not open.
        axes: Names of its axes.
        where: The socket, None for that of the driver's default options.
        trace: CSV file for every write that is taken, None for none.
        ready: Told the socket as soon as clients are heard.

    Raises:
        DeviceUnavailableError: If the socket is taken or cannot be made.
        DeviceError: If the device is not sensor and amplifier in one, or cannot be opened.
        OSError: If the trace cannot be written.
    """
    if not (isinstance(rig, Sensor) and isinstance(rig, Amplifier)):
        raise DeviceError("only a device that is sensor and amplifier in one can be hosted")
    path = _default_socket() if where is None else where
    with _told_to_end() as stopping, closing(rig), _tracing(trace, axes) as writes:
        identity = rig.open()
        with listening(path) as listener:
            server = RigServer(rig, identity, listener, _real_time, writes)
            ready(path)
            server.serve(stopping)


def _real_time(_asked_ns: int) -> int:
    return time.monotonic_ns()


def _tracing(path: Path | None, axes: Sequence[str]) -> AbstractContextManager[Trace | None]:
    return nullcontext() if path is None else Trace(path, axes)


@contextmanager
def listening(path: Path) -> Iterator[socket.socket]:
    """Listen at a socket that only this user can use; one that nobody serves is replaced.

    Raises:
        DeviceUnavailableError: If somebody serves it, or it cannot be made.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        try:
            _remove_stale(path)
            listener.bind(str(path))
            path.chmod(0o600)
            listener.listen()
        except OSError as error:
            raise DeviceUnavailableError(f"no socket can be made at {path}: {error}") from error
        try:
            yield listener
        finally:
            path.unlink(missing_ok=True)


def _remove_stale(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        try:
            probe.connect(str(path))
        except FileNotFoundError:
            return
        except ConnectionRefusedError:
            path.unlink()
            return
    raise DeviceUnavailableError(f"another rig is hosted at {path}")


def _default_socket() -> Path:
    """Return the socket of the default options, in a folder that belongs to this user.

    Raises:
        DeviceUnavailableError: If the folder belongs to somebody else.
    """
    path = socket_path(DEFAULT_SOCKET)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if path.parent.stat().st_uid != os.getuid():
        raise DeviceUnavailableError(f"{path.parent} belongs to somebody else, name a socket")
    return path


@contextmanager
def _told_to_end() -> Iterator[Callable[[], bool]]:
    """Tell from SIGINT and SIGTERM, for as long as the block runs, that the process is to end."""
    told = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: told.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield told.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
