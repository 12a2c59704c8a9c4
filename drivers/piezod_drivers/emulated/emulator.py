"""Serves the rig itself at a socket, for the driver `emulated`."""

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
    """Serve a rig at a socket until `stopping` returns True.

    Args:
        bench: The rig.
        where: The socket, "" for that of the driver's default options.
        faults: Without effect.
        serial_number: Serial number, "" for that of the rig.
        ready: Called with the socket as soon as clients can connect.
        stopping: Called at least every 10 ms; returns whether to stop.

    Raises:
        DeviceUnavailableError: If the socket is in use or cannot be created.
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
    """Listen at a socket that only this user can use; an abandoned one is replaced.

    Raises:
        DeviceUnavailableError: If another process serves it, or it cannot be created.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        try:
            _remove_stale(path)
            listener.bind(str(path))
            # Before `listen`: no other user can connect in between.
            path.chmod(0o600)
            listener.listen()
        except OSError as error:
            raise DeviceUnavailableError(f"cannot create a socket at {path}: {error}") from error
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
        # Nothing listens: an emulator that was killed has left its socket behind.
        except ConnectionRefusedError:
            path.unlink()
            return
    raise DeviceUnavailableError(f"another rig is hosted at {path}")


EMULATOR: Final = EmulatorPlugin(
    name="simulated",
    summary="the rig itself at a unix socket, for devices with driver: emulated",
    wire="socket",
    serve=serve,
)
