"""What a configuration may say about a CAN bus."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, Self, TypeAlias

from pydantic import Field, StringConstraints, model_validator

from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.devices.bus.serial_line import SerialLine
from piezod_drivers.can_bus.frame import most_bits
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
    """A CAN bus and what connects this machine to it."""

    interface: _Text = Field(
        default=SOCKETCAN,
        description="socketcan, slcan, udp_multicast or virtual, or another one of python-can.",
    )
    channel: _Text = Field(
        description="What the interface calls the bus: can0; for slcan the adapter's port, "
        "/dev/serial/by-id/…; for udp_multicast an address such as 239.74.163.2."
    )
    bit_rate: Annotated[int, Quantity(10_000, 1_000_000, "bit/s")] = Field(
        default=500_000,
        description="Bits per second of the bus. slcan sets it; socketcan has it set by "
        "`ip link`, and it only tells here how fast a loop can be.",
    )
    baud: Annotated[int, Quantity(9600, 4_000_000, "bit/s")] = Field(
        default=1_000_000, description="Of the port of an slcan adapter; USB ones do not care."
    )
    port: Annotated[int, Quantity(1024, 65_535)] = Field(
        default=43_113, description="UDP port, for udp_multicast."
    )

    @model_validator(mode="after")
    def _check_bit_rate(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.interface == SLCAN and self.bit_rate not in BIT_RATES:
            allowed = ", ".join(map(str, BIT_RATES))
            yield ("bit_rate",), f"slcan has no {self.bit_rate} bit/s, allowed: {allowed}"


def make_bus(options: BusOptions) -> FrameBus:
    """Construct the bus that options name; nothing is opened."""
    if options.interface == SLCAN:
        return SlcanBus(SerialLine(options.channel, options.baud), options.bit_rate)
    settings: dict[str, Any] = {}
    if options.interface == UDP_MULTICAST:
        settings = {"port": options.port, "hop_limit": 0, "fd": False}  # it stays in this machine
    elif options.interface not in {SOCKETCAN, "virtual"}:
        settings = {"bitrate": options.bit_rate}
    return LibraryBus(options.interface, options.channel, settings)


def highest_rate_hz(options: BusOptions, sizes: list[int]) -> float:
    """Return the rate at which frames of these sizes fill the bus, each once a cycle.

    Args:
        options: The bus; in one that is no wire nothing takes time.
        sizes: Bytes of data of each frame of a cycle.
    """
    if options.interface in _IN_THIS_MACHINE:
        return _HIGHEST_RATE_HZ
    return min(options.bit_rate / sum(map(most_bits, sizes)), _HIGHEST_RATE_HZ)
