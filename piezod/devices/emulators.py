"""Lookup of emulated devices by the name of their profile, and their service on one rig.

An emulator is an entry point of the group `piezod.emulators` that refers to an `EmulatorPlugin`.
"""

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from piezod.devices import plugins
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.emulation.far_end import FarEnd
from piezod.devices.emulation.faults import WireFaults
from piezod.devices.emulation.places import address, make_own_folder
from piezod.devices.emulation.pty_end import PtyEnd
from piezod.devices.emulation.tcp_end import TcpEnd
from piezod.devices.emulation.two_port_end import TwoPortEnd
from piezod.devices.emulation.wire_host import WireHost
from piezod.errors import RegistryError

GROUP: Final = "piezod.emulators"


def names() -> tuple[str, ...]:
    """Return the names of all profiles with an emulator, sorted, without importing them."""
    return plugins.names(GROUP)


def load(name: str) -> EmulatorPlugin:
    """Import and return the emulator of one profile.

    Args:
        name: Name of the profile, one of `names()`.

    Raises:
        RegistryError: If no emulator or several have this name, or if it cannot be imported or is
            not an emulator of that name.
    """
    return plugins.load(GROUP, "emulator", EmulatorPlugin, name)


class EmulationRequest(NamedTuple):
    """A device to emulate."""

    plugin: EmulatorPlugin  #: Its emulator.
    where: str  #: Place of the service; "" for the default.
    faults: WireFaults  #: Wire faults.


class Emulation:
    """Emulated devices on one rig, each in its own thread; also a context manager.

    Args:
        posts: The devices.
        bench: The rig that all of them are connected to, axis by axis.
        serial_number: Serial number of each device, "" for its default.
    """

    def __init__(
        self, posts: Sequence[EmulationRequest], bench: SharedRig, serial_number: str = ""
    ) -> None:
        self._bench, self._serial_number = bench, serial_number
        self._stop = threading.Event()
        self._news = threading.Condition()
        self._places: dict[int, str] = {}
        self._failure: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._run, args=(number, post))
            for number, post in enumerate(posts)
        ]

    def start(self) -> list[str]:
        """Serve all devices; return their places as soon as all can be reached.

        Raises:
            DeviceError: If one of them cannot be served; then none is.
        """
        for thread in self._threads:
            thread.start()
        # Either all devices can be reached, or the first failure stops the others.
        with self._news:
            self._news.wait_for(lambda: self._failure or len(self._places) == len(self._threads))
        if self._failure is not None:
            self.stop()
        return [self._places[number] for number in range(len(self._threads))]

    def running(self) -> bool:
        """Return whether all devices are still served."""
        return self._failure is None

    def stop(self) -> None:
        """Stop serving; must be called at the end.

        Raises:
            Exception: The error that ended one of the devices.
        """
        self._stop.set()
        for thread in self._threads:
            if thread.ident is not None:  # a thread that was never started cannot be joined
                thread.join()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _run(self, number: int, post: EmulationRequest) -> None:
        def ready(place: str) -> None:
            with self._news:
                self._places[number] = place
                self._news.notify_all()

        try:
            self._serve(post, ready)
        except BaseException as failure:  # noqa: BLE001 - raised again by `stop`
            with self._news:
                self._failure = failure
                self._news.notify_all()

    def _serve(self, post: EmulationRequest, ready: Callable[[str], None]) -> None:
        plugin, bench, stopping = post.plugin, self._bench, self._stop.is_set
        if plugin.serve is not None:
            plugin.serve(bench, post.where, post.faults, self._serial_number, ready, stopping)
        elif plugin.create is None:
            raise RegistryError(f"the emulator {plugin.name!r} has neither `create` nor `serve`")
        else:
            create, end = plugin.create, _far_end(plugin, post.where)
            host = WireHost(
                end, lambda serial: create(bench, serial), bench, post.faults, self._serial_number
            )
            host.serve(ready, stopping)


def _far_end(plugin: EmulatorPlugin, where: str) -> FarEnd:
    if plugin.wire == "tcp":
        host, port = address(where)
        if plugin.stream_port:
            return TwoPortEnd(host, port, plugin.stream_port)
        return TcpEnd(host, port)
    return PtyEnd(Path(where) if where else make_own_folder() / f"{plugin.name}.tty")
