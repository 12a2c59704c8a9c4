"""The buses that are measured, each with a profile that stands for it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from piezod.devices.interface import Wiring


class Case(NamedTuple):
    """A bus.

    Attributes:
        name: What it is called in the table.
        profile: Emulator that is the peer.
        driver: Name of the driver.
        options: Options of the driver, for where the emulator is served.
        wiring: Channels that a cycle reads and drives.
        wire: "serial" or "tcp".
        text: Whether replies are lines of any length.
        limit: What the median may be, as a multiple of the floor's.
        baud: Line rate for which the wire time is computed, in bit/s; 0 where it does not count.
    """

    name: str
    profile: str
    driver: str
    options: Callable[[str], Mapping[str, Any]]
    wiring: Wiring
    wire: str
    text: bool
    limit: float
    baud: int = 0


CASES = (
    Case(
        "serial, GCS 1 (pty)", "pi-e816", "pi_gcs1",
        lambda port: {"port": port}, Wiring(("A",), ("A",)), "serial", True, 1.3, 115_200,
    ),
)  # fmt: skip
