"""The devices of a stage, opened by a thread that tries again until they are there."""

import threading

from piezod.config.daemon import DaemonConfig
from piezod.daemon.clock import Clock
from piezod.devices.channels import Channels
from piezod.devices.waits import waits_s
from piezod.devices.wiring import construct, pairs_of
from piezod.errors import DeviceError


def make_channels(config: DaemonConfig) -> Channels:
    """Construct the devices; nothing is opened.

    Raises:
        DeviceError: If a device cannot play the role that an axis gives it.
        RegistryError: If a driver cannot be loaded.
    """
    axes = pairs_of(config.axes)
    return Channels(construct(config.devices, axes, config.seed), axes)


class Opening(threading.Thread):
    """Opens and activates devices, again and again; the loop's process lives on meanwhile.

    Args:
        channels: The devices; nobody else uses them until this thread has ended.
        clock: The clock of the loop.
    """

    def __init__(self, channels: Channels, clock: Clock) -> None:
        super().__init__(name="opening", daemon=True)
        self._channels, self._clock = channels, clock
        self._stopped = threading.Event()
        self.absent = ""
        """Why the last attempt failed; empty as long as none has."""
        self.crash: Exception | None = None
        """What ended it other than success, if anything did."""

    def run(self) -> None:
        """Try until it succeeds, or until `stop`."""
        waits = waits_s()
        try:
            while not self._stopped.is_set() and not self._opened():
                self._stopped.wait(next(waits))
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way; told by main
            self.crash = error

    def stop(self) -> None:
        """Give up after the attempt that is under way."""
        self._stopped.set()

    def _opened(self) -> bool:
        try:
            self._channels.open()
            self._channels.activate(self._clock.now_ns())
        except DeviceError as error:
            self.absent = str(error)
            self._channels.close()
            return False
        return True
