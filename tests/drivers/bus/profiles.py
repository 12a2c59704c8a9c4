"""One row for each device that can be emulated at a pty or a TCP port, with the driver for it.

Everything in `test_generic*.py` is done with each of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from piezod.devices import registry
from piezod.devices.interface import Device, Wiring

Options = Callable[[str, float], Mapping[str, object]]
"""Options of a driver for a place, as `piezod emulate` prints it, and a time-out in ms."""


@dataclass(frozen=True)
class Profile:
    """A device and its driver.

    Attributes:
        name: Of the profile, as `piezod emulate` takes it.
        driver: Name of the driver.
        wiring: Channels of the device: all of them are used.
        options: Of the driver.
        arguments: Of `piezod emulate`.
        streams: Whether the device sends by itself, so that no reply is lost, late or first.
        tells_serial: Whether its identity has the serial number, so that another one can be told.
        seam: Where the driver finds its line, to put another one in its place.
    """

    name: str
    driver: str
    wiring: Wiring
    options: Options
    arguments: tuple[str, ...] = ()
    streams: bool = False
    tells_serial: bool = True
    seam: str = "piezod_drivers.serial_line.options"

    def device(self, where: str, timeout_ms: float = 2000.0) -> Any:
        """Construct the driver's device for a place; by default it waits long for replies."""
        plugin = registry.load(self.driver)
        options = plugin.options_model.model_validate(dict(self.options(where, timeout_ms)))
        device: Device = plugin.create(options, self.wiring, 1)
        return device


@dataclass(frozen=True)
class Port:
    """Options of a driver with `port` and `timeout_ms`.

    Attributes:
        others: Its other options.
    """

    others: Mapping[str, object] = field(default_factory=dict)

    def __call__(self, where: str, timeout_ms: float) -> Mapping[str, object]:
        """Return the options for a place."""
        return {"port": where, "timeout_ms": timeout_ms, **self.others}


@dataclass(frozen=True)
class Tcp:
    """Options of a driver with `host`, `tcp_port` and `timeout_ms`.

    Attributes:
        others: Its other options.
    """

    others: Mapping[str, object] = field(default_factory=dict)

    def __call__(self, where: str, timeout_ms: float) -> Mapping[str, object]:
        """Return the options for a place."""
        host, _, port = where.rpartition(":")
        return {"host": host, "tcp_port": int(port), "timeout_ms": timeout_ms, **self.others}


PROFILES = (
    Profile("pi-e816", "pi_gcs1", Wiring.both(("A",)), Port()),
    Profile("pi-gcs2", "pi_gcs2", Wiring.both(("1",)), Port()),
    Profile("pi-gcs2-tcp", "pi_gcs2", Wiring.both(("1",)), Tcp()),
    Profile("mdt693a", "thorlabs_mdt", Wiring((), ("x",)), Port()),
    Profile("mdt693b", "thorlabs_mdt", Wiring((), ("x", "y", "z")), Port(), ("--axes", "3")),
    Profile("mdt694b", "thorlabs_mdt", Wiring((), ("x",)), Port()),
    Profile("kpz101", "thorlabs_apt", Wiring((), ("1",)), Port()),
    Profile("ksg101", "thorlabs_apt", Wiring(("1",), ()), Port()),
    Profile("psj-ddrive", "psj", Wiring((), ("ch0",)), Port({"profile": "ddrive"})),
    Profile("psj-nv40", "psj", Wiring.both(("ch0",)), Port({"profile": "nv40"})),
    Profile("psj-nv200", "psj", Wiring.both(("ch0",)), Port({"profile": "nv200"})),
)
