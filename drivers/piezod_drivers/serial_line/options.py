"""What a configuration may say about a serial port, or about the TCP port of the same protocol."""

from collections.abc import Iterator
from typing import Annotated, Final, Self, TypeAlias

from pydantic import Field, StringConstraints, model_validator

from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.devices.bus.line import Line
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine

Port: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
Host: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=253)]
Baud: TypeAlias = Annotated[int, Quantity(300, 4_000_000, "bit/s")]
TimeoutMs: TypeAlias = Annotated[float, Quantity(1, 5000, "ms")]

_PORT: Final = "Path of the port: /dev/serial/by-id/…."


class _Settings(ConfigModel):
    baud: Baud = Field(default=115_200, description="Bits per second, as set on the device.")
    rtscts: bool = Field(default=False, description="Whether RTS and CTS hold up the flow.")
    timeout_ms: TimeoutMs = Field(default=30.0, description="How long to wait for each reply, ms.")

    def baud_or(self, usual: int) -> int:
        """Return `baud` where it is given, else what is usual for the model of the device."""
        return self.baud if "baud" in self.model_fields_set else usual


class PortOptions(_Settings):
    """A serial port; a protocol gives its own defaults to `baud`, `rtscts` and `timeout_ms`."""

    port: Port = Field(description=_PORT)


class LineOptions(_Settings):
    """A serial port, or else the TCP port of a device that speaks the same protocol there."""

    port: Port | None = Field(default=None, description=_PORT)
    host: Host | None = Field(
        default=None,
        description="Name or address, instead of `port`: the device's own or a serial server's.",
    )
    tcp_port: Annotated[int, Quantity(1, 65_535)] | None = Field(
        default=None, description="Number of the TCP port at `host`."
    )

    @model_validator(mode="after")
    def _check_line(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterator[BrokenRule]:
        """Yield what is wrong; who overrides it yields these too."""
        if (self.port is None) == (self.host is None):
            yield ("port",), "name either port, a serial port, or host and tcp_port"
        elif (self.host is None) != (self.tcp_port is None):
            yield ("tcp_port",), "host and tcp_port belong together"


def ordered(range_v: tuple[float, float]) -> Iterator[BrokenRule]:
    """Yield what is wrong with a lowest and a highest voltage: that there is none between them."""
    if not range_v[0] < range_v[1]:
        yield ("range_v", 1), "must be above the first of the two"


def make_line(options: PortOptions | LineOptions, baud: int | None = None) -> Line:
    """Construct the line that options name; nothing is opened.

    Args:
        options: What a configuration says.
        baud: Bits per second, where `options.baud` may be that of another model.
    """
    if isinstance(options, LineOptions) and options.host is not None:
        assert options.tcp_port is not None  # noqa: S101 - the model has checked it
        return TcpLine(options.host, options.tcp_port)
    assert options.port is not None  # noqa: S101 - likewise
    return SerialLine(options.port, baud or options.baud, rtscts=options.rtscts)
