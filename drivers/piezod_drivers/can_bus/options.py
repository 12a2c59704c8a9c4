"""Options of a CAN bus."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.bus.serial_line import SerialLine, SettleMs
from piezod_drivers.can_bus.frame import max_frame_bits
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.library_bus import SOCKETCAN, LibraryBus
from piezod_drivers.can_bus.slcan_bus import SlcanBus
from piezod_drivers.can_bus.slcan_codec import BIT_RATES

SLCAN: Final = "slcan"
UDP_MULTICAST: Final = "udp_multicast"
_IN_THIS_MACHINE: Final = frozenset({UDP_MULTICAST, "virtual"})
_HIGHEST_RATE_HZ: Final = 20_000.0

_Text: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
TimeoutMs: TypeAlias = Annotated[float, Quantity(0.5, 5000, "ms")]


class BusOptions(ConfigModel):
    """Options of a CAN bus and of the adapter that connects this machine to it."""

    interface: _Text = Field(
        default=SOCKETCAN,
        description="socketcan, slcan, udp_multicast, virtual, or another interface of python-can.",
    )
    channel: _Text = Field(
        description="Name of the bus at the interface: can0; for slcan the adapter's port, "
        "/dev/serial/by-id/…; for udp_multicast an address such as 239.74.163.2."
    )
    bit_rate: Annotated[int, Quantity(10_000, 1_000_000, "bit/s")] = Field(
        default=500_000,
        description="Bits per second of the bus. slcan sets it. With socketcan `ip link` sets it, "
        "and this value only serves to compute the highest loop rate.",
    )
    baud: Annotated[int, Quantity(9600, 4_000_000, "bit/s")] = Field(
        default=1_000_000,
        description="Bits per second of the port of an slcan adapter; USB adapters ignore it.",
    )
    settle_ms: SettleMs = 0.0
    port: Annotated[int, Quantity(1024, 65_535)] = Field(
        default=43_113, description="Number of the UDP port, for udp_multicast."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.interface == SLCAN and self.bit_rate not in BIT_RATES:
            allowed = ", ".join(map(str, BIT_RATES))
            yield ("bit_rate",), f"slcan does not support {self.bit_rate} bit/s, allowed: {allowed}"


def make_bus(options: BusOptions) -> FrameBus:
    """Construct the bus that the options describe; nothing is opened."""
    if options.interface == SLCAN:
        line = SerialLine(options.channel, options.baud, settle_s=options.settle_ms * 1e-3)
        return SlcanBus(line, options.bit_rate)
    settings: dict[str, Any] = {}
    if options.interface == UDP_MULTICAST:
        # Hop limit 0: no packet leaves this machine, so that a test never reaches a real network.
        settings = {"port": options.port, "hop_limit": 0, "fd": False}
    elif options.interface not in {SOCKETCAN, "virtual"}:
        settings = {"bitrate": options.bit_rate}
    return LibraryBus(options.interface, options.channel, settings)


def max_rate_hz(options: BusOptions, sizes: list[int]) -> float:
    """Return the rate in Hz at which frames of these sizes, each once a cycle, fill the bus.

    Args:
        options: Options of the bus. On a bus within this machine frames take no time.
        sizes: Number of data bytes of each frame of a cycle.
    """
    if options.interface in _IN_THIS_MACHINE:
        return _HIGHEST_RATE_HZ
    return min(options.bit_rate / sum(map(max_frame_bits, sizes)), _HIGHEST_RATE_HZ)
