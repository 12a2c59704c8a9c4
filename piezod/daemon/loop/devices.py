"""The devices of a stage, and the thread that opens them."""

import threading
from collections.abc import Mapping
from types import MappingProxyType

from piezod.config.daemon import DaemonConfig
from piezod.daemon.clock import Clock
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, is_same
from piezod.devices.waits import waits_s
from piezod.devices.wiring import construct, pairs_of
from piezod.errors import DeviceError, PortHeldError


def make_channels(config: DaemonConfig) -> Channels:
    """Construct the devices; open none.

    Raises:
        DeviceError: If a device cannot play the role that an axis assigns to it.
        RegistryError: If a driver cannot be loaded.
    """
    axes = pairs_of(config.axes)
    devices = construct(config.devices, axes, config.seed, config.lines)
    return Channels(devices, axes, config.lines)


class DeviceOpener(threading.Thread):
    """Opens and activates devices in a thread, and tries again until it succeeds.

    Args:
        channels: The devices; until this thread has ended, only it uses them.
        clock: The clock of the loop.
        known: Identities that devices must have, by name.
    """

    def __init__(
        self, channels: Channels, clock: Clock, known: Mapping[str, Identity] = MappingProxyType({})
    ) -> None:
        super().__init__(name="opening", daemon=True)
        self._channels, self._clock, self._known = channels, clock, known
        self._stopped = threading.Event()
        self.absent = ""
        """Why the last attempt failed; empty if none has failed."""
        self.held = False
        """Whether it failed because another program holds a port."""
        self.crash: Exception | None = None
        """Exception that ended the thread; None if none did."""

    def run(self) -> None:
        """Try until the devices are open and active, or until `stop`."""
        waits = waits_s()
        try:
            while not self._stopped.is_set() and not self._opened():
                self._stopped.wait(next(waits))  # ends early on `stop`
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way; raised by main
            self.crash = error

    def stop(self) -> None:
        """End the thread after the present attempt."""
        self._stopped.set()

    def _opened(self) -> bool:
        try:
            self._channels.open()
            self._check_identities()
            self._channels.activate(self._clock.now_ns())
        except DeviceError as error:
            # Only a `DeviceError` may pass by itself; any other exception is a mistake in a driver.
            self.held = isinstance(error, PortHeldError)
            self.absent = str(error)
            self._channels.close()
            return False
        return True

    def _check_identities(self) -> None:
        for name, found in self._channels.identities.items():
            known = self._known.get(name, found)
            if not is_same(found, known):
                who, wanted = (" ".join(each[:3]) for each in (found, known))
                raise DeviceError(
                    f"{name} is another device: {who}, expected: {wanted}; connect that one, or "
                    "restart the daemon to use this one"
                )
