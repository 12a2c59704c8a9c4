"""A rig served by a thread of the test, in the test's time."""

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from piezod.devices import registry
from piezod.devices.emulation.trace import Trace
from piezod.devices.interface import Wiring
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.host import listening
from piezod_drivers.emulated.options import Options
from piezod_drivers.emulated.server import RigServer

T0_NS = 1_000_000_000
MS = 1_000_000


class AskedTime:
    """Passes as the instants that calls carry; one who begins anew does not set it back."""

    def __init__(self) -> None:
        self._now_ns = self._asked_ns = 0

    def __call__(self, asked_ns: int) -> int:
        """Return the rig's time."""
        self._now_ns += max(asked_ns - self._asked_ns, 0)
        self._asked_ns = asked_ns
        return self._now_ns


@contextmanager
def serving(
    path: Path, axes: tuple[str, ...] = ("x",), trace: Path | None = None
) -> Iterator[None]:
    """Serve a simulated rig at a socket while the block runs."""
    plugin = registry.load("simulated")
    rig = plugin.create(plugin.options_model(), Wiring.both(axes), 1)
    stopping = threading.Event()
    with ExitStack() as stack:
        writes = stack.enter_context(Trace(trace, axes)) if trace else None
        identity = rig.open()
        stack.callback(rig.close)
        listener: socket.socket = stack.enter_context(listening(path))
        server = RigServer(rig, identity, listener, AskedTime(), writes)  # type: ignore[arg-type] # it is both
        thread = threading.Thread(target=server.serve, args=(stopping.is_set,))
        thread.start()
        stack.callback(thread.join)
        stack.callback(stopping.set)
        yield


def driver_of(path: Path, axes: tuple[str, ...] = ("x",)) -> EmulatedRig:
    """Construct a driver for the rig at a socket; the deadline is one that no test waits for."""
    return EmulatedRig(Options(socket=str(path), deadline_ms=1000.0), axes)
