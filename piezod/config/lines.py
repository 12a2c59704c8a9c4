"""Lines of the loop: digital inputs that it reads, and digital outputs that it sets, by name."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

from pydantic import Field

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Drivers
from piezod.config.messages import show, suggest
from piezod.config.quantities import Name

if TYPE_CHECKING:
    from piezod.config.devices import DeviceConfig

MOST_LINES: Final = 8


class LineConfig(ConfigModel):
    """A digital input or output of a device, which is high at the value 1 and low at 0."""

    device: Name = Field(description="Name of the device.")
    input: ChannelName | None = Field(
        default=None, description="Name of the input that the loop reads."
    )
    output: ChannelName | None = Field(
        default=None, description="Name of the output that the loop sets."
    )

    @property
    def channel(self) -> str:
        """Name of its channel."""
        return self.input or self.output or ""

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if (self.input is None) == (self.output is None):
            yield ("input",), "give either input, which is read, or output, which is set"


def refusal(name: str, lines: Mapping[str, LineConfig], *, sets: bool) -> str:
    """Return why a line cannot be used; empty if it can. Real-time safe.

    Args:
        name: Its name.
        lines: The lines of the stage by name.
        sets: Whether it is to be set, and not read.
    """
    line = lines.get(name)
    if line is None:
        known = ", ".join(lines) or "none: name digital channels in `lines:` of its configuration"
        return f"no line {name!r}; the stage has {known}"
    if sets and line.output is None:
        return f"line {name} is an input, which nothing can set: name an output"
    return ""


def broken_lines(
    lines: Mapping[str, LineConfig],
    devices: Mapping[str, "DeviceConfig"],
    driven: Mapping[tuple[str, str], str],
    drivers: Drivers | None,
) -> Iterator[BrokenRule]:
    """Yield the errors of lines whose device or channel does not exist, or is in use.

    Args:
        lines: The lines by name.
        devices: The devices by name.
        driven: Name of the axis that drives an output, by its device and its channel.
        drivers: Drivers, which list the channels of their devices; None if they are not available.
    """
    used = dict(driven)
    for name, line in lines.items():
        role = "input" if line.output is None else "output"
        if line.device not in devices:
            what = f"no such device (got {show(line.device)}), "
            what += suggest(line.device, list(devices), "known")
            yield ("lines", name, "device"), what
            continue
        if drivers is not None:
            device = devices[line.device]
            has = drivers.load(device.driver).channels(device.options)
            units = None if has is None else has.inputs if role == "input" else has.outputs
            if units is not None and line.channel not in units:
                what = f"no such {role} (got {show(line.channel)}), "
                yield ("lines", name, role), what + suggest(line.channel, list(units), "known")
        if role == "output":
            other = used.setdefault((line.device, line.channel), f"line {name}")
            if other != f"line {name}":
                yield ("lines", name, role), f"{other} drives this output already: name another one"
