"""The measured buses, each with a profile that represents it."""

from typing import NamedTuple

from benchmarks.bus.example import Place, at_adapter, at_host, at_multicast, at_port, at_pty


class Case(NamedTuple):
    """A bus."""

    name: str  #: Name in the table.
    profile: str  #: Emulator of the peer.
    example: str  #: Example configuration with the driver's options and the channels in use.
    place: Place  #: Writes the emulator's place into the options.
    wire: str  #: "serial", "tcp" or "udp".
    limit: float  #: Highest allowed median, as a multiple of the floor's.
    text: bool = False  #: Whether replies are lines of any length.
    #: Whether the peer also sends by itself; those bytes are read before each request.
    unasked: bool = False
    line_rate: int = 0  #: Line rate for the computed wire time, in bit/s; 0 if it does not matter.
    bits_per_byte: float = 10.0  #: Bits of a byte on this line, framing included.
    silence_us: float = 0.0  #: Silence before each request that the protocol requires at this rate.


CASES = (
    Case(
        "serial, PI GCS 1",
        "pi-e816",
        "pi-e816",
        at_port,
        "serial",
        1.3,
        text=True,
        line_rate=115_200,
    ),
    Case(
        "serial, PI GCS 2",
        "pi-gcs2",
        "pi-gcs2",
        at_port,
        "serial",
        1.3,
        text=True,
        line_rate=115_200,
    ),
    Case("serial, nPoint LC.400", "lc400", "lc400", at_port, "serial", 1.3, line_rate=115_200),
    Case(
        "Modbus RTU, ICP DAS",
        "icpdas",
        "icpdas",
        at_pty,
        "serial",
        1.3,
        line_rate=115_200,
        silence_us=1750,
    ),
    Case(
        "Modbus RTU, Waveshare",
        "waveshare",
        "waveshare",
        at_pty,
        "serial",
        1.3,
        line_rate=115_200,
        silence_us=1750,
    ),
    Case("Modbus TCP, LabJack T7", "labjack-t7", "labjack-t7", at_host, "tcp", 1.5),
    Case("Modbus TCP, WAGO 750", "wago-750", "wago-750", at_host, "tcp", 1.5),
    # An slcan adapter sends about 23 characters for a frame of 8 bytes, which has about 125 bits.
    Case(
        "slcan, CANopen",
        "canopen-401",
        "canopen-401",
        at_adapter,
        "serial",
        1.3,
        unasked=True,
        line_rate=500_000,
        bits_per_byte=5.4,
    ),
    Case(
        "slcan, DBC",
        "can-dbc-demo",
        "can-dbc",
        at_adapter,
        "serial",
        1.3,
        unasked=True,
        line_rate=500_000,
        bits_per_byte=5.4,
    ),
    Case(
        "udp_multicast, CANopen",
        "canopen-401",
        "canopen-401",
        at_multicast,
        "udp",
        2.0,
        unasked=True,
    ),
    Case("udp_multicast, DBC", "can-dbc-demo", "can-dbc", at_multicast, "udp", 2.0, unasked=True),
)
