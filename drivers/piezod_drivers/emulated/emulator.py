"""Serves a bench itself at a socket: what drives it is the driver `emulated`."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.emulation.faults import WireFaults
from piezod.devices.emulation.places import make_own_folder
from piezod.errors import DeviceUnavailableError
from piezod_drivers.emulated.emulation.server import RigServer
from piezod_drivers.emulated.options import DEFAULT_SOCKET


def serve(
    bench: SharedRig,
    where: str,
    faults: WireFaults,  # noqa: ARG001 - packets of a socket are neither late nor lost
    serial_number: str,
    ready: Callable[[str], None],
    stopping: Callable[[], bool],
) -> None:
    """Serve a bench at a socket until told to stop.

    Args:
        bench: The bench.
        where: The socket, "" for that of the driver's default options.
        faults: Without effect.
        serial_number: Of the rig, "" for that of the bench.
        ready: Told the socket as soon as clients are heard.
        stopping: Asked at least every 10 ms.

    Raises:
        DeviceUnavailableError: If the socket is taken or cannot be made.
    """
    path = Path(where) if where else make_own_folder() / DEFAULT_SOCKET
    identity = bench.identity
    if serial_number:
        identity = identity._replace(serial=serial_number)
    with listening(path) as listener:
        server = RigServer(bench, identity, listener)
        ready(str(path))
        server.serve(stopping)


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


EMULATOR: Final = EmulatorPlugin(
    name="simulated",
    summary="the bench itself at a unix socket, for devices with driver: emulated",
    wire="socket",
    serve=serve,
)
