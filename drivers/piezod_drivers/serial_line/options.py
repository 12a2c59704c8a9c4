"""Options of a serial port, or of a TCP port with the same protocol."""

from collections.abc import Iterator
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.bus.line import Line
from piezod.devices.bus.serial_line import SerialLine, SettleMs
from piezod.devices.bus.tcp_line import TcpLine

Port: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
Host: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=253)]
Baud: TypeAlias = Annotated[int, Quantity(300, 4_000_000, "bit/s")]
TimeoutMs: TypeAlias = Annotated[float, Quantity(1, 5000, "ms")]
WaveEnd: TypeAlias = Annotated[
    Literal["unknown", "holds"],
    Field(
        description="The output after the last cycle of a wave: `holds` if you have seen that it "
        "keeps the last value. If it is unknown, tables must end at rest."
    ),
]

_PORT: Final = "Path of the port: /dev/serial/by-id/…."


class _Settings(ConfigModel):
    baud: Baud = Field(default=115_200, description="Bits per second, as set on the device.")
    rtscts: bool = Field(default=False, description="Whether RTS and CTS control the flow.")
    timeout_ms: TimeoutMs = Field(default=30.0, description="Longest wait for each reply, ms.")
    settle_ms: SettleMs = 0.0

    def baud_or(self, usual: int) -> int:
        """Return `baud` if it is configured, else the usual value of the device's model."""
        return self.baud if "baud" in self.model_fields_set else usual


class PortOptions(_Settings):
    """Options of a serial port; a protocol may change the defaults."""

    port: Port = Field(description=_PORT)


class LineOptions(_Settings):
    """Options of a serial port, or of the TCP port of a device with the same protocol."""

    port: Port | None = Field(default=None, description=_PORT)
    host: Host | None = Field(
        default=None,
        description="Instead of `port`: host name or address of the device or of a serial server.",
    )
    tcp_port: Annotated[int, Quantity(1, 65_535)] | None = Field(
        default=None, description="Number of the TCP port at `host`."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:

        if (self.port is None) == (self.host is None):
            yield ("port",), "give either port, a serial port, or host and tcp_port"
        elif (self.host is None) != (self.tcp_port is None):
            yield ("tcp_port",), "give both host and tcp_port"


def range_rules(range_v: tuple[float, float]) -> Iterator[BrokenRule]:
    """Yield the broken rule if the lowest voltage is not below the highest."""
    if not range_v[0] < range_v[1]:
        yield ("range_v", 1), "must be above the first of the two"


def make_line(options: PortOptions | LineOptions, baud: int | None = None) -> Line:
    """Construct the line of the options; nothing is opened.

    Args:
        options: The options.
        baud: Bits per second, if they are not `options.baud`.
    """
    if isinstance(options, LineOptions) and options.host is not None:
        assert options.tcp_port is not None  # noqa: S101 - the model has checked it
        return TcpLine(options.host, options.tcp_port)
    assert options.port is not None  # noqa: S101 - likewise
    settle_s = options.settle_ms * 1e-3
    return SerialLine(options.port, baud or options.baud, rtscts=options.rtscts, settle_s=settle_s)
