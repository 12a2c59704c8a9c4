"""A rig served by a thread of the test, in the test's time."""

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from piezod.devices import registry
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.trace import Trace
from piezod.devices.interface import Wiring
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.emulation.server import RigServer
from piezod_drivers.emulated.emulator import listening
from piezod_drivers.emulated.options import EmulatedOptions

T0_NS = 1_000_000_000
MS = 1_000_000


class AskedTime:
    """A clock that advances to the instants of the calls, and never goes back."""

    def __init__(self) -> None:
        self._now_ns = self._asked_ns = 0

    def heard(self, asked_ns: int) -> None:
        """Advance to the instant of a call."""
        self._now_ns += max(asked_ns - self._asked_ns, 0)
        self._asked_ns = asked_ns

    def now_ns(self) -> int:
        """Return the rig's time."""
        return self._now_ns


@contextmanager
def serving(
    path: Path, axes: tuple[str, ...] = ("x",), trace: Path | None = None
) -> Iterator[None]:
    """Serve a simulated rig at a socket while the block runs."""
    plugin = registry.load("simulated")
    inputs = tuple(name for axis in axes for name in (axis, f"{axis}_v"))
    rig = plugin.create(plugin.options_model(), Wiring(inputs, axes), 1)
    stopping, time = threading.Event(), AskedTime()
    with ExitStack() as stack:
        writes = stack.enter_context(Trace(trace, axes)) if trace else None
        identity = rig.open()
        stack.callback(rig.close)
        rig.activate(0)
        bench = SharedRig(rig, time.now_ns, writes)  # type: ignore[arg-type] # it is both
        listener: socket.socket = stack.enter_context(listening(path))
        server = RigServer(bench, identity, listener, time.heard)
        thread = threading.Thread(target=server.serve, args=(stopping.is_set,))
        thread.start()
        stack.callback(thread.join)
        stack.callback(stopping.set)
        yield


def driver_of(path: Path, axes: tuple[str, ...] = ("x",)) -> EmulatedRig:
    """Construct a driver for the rig at a socket, with a deadline that no test reaches."""
    return EmulatedRig(EmulatedOptions(socket=str(path), deadline_ms=1000.0), axes)
