"""The channels of a PI controller."""

from collections.abc import Sequence
from typing import Protocol

from piezod.devices.interface import ChannelUnits


class HasAxes(Protocol):
    """Options of either generation."""

    @property
    def axes(self) -> Sequence[str]:
        """Identifiers of the axes of the controller."""
        ...


def channels(options: HasAxes) -> ChannelUnits:
    """Return the channels: each axis has a position in µm and a voltage in V."""
    return ChannelUnits(dict.fromkeys(options.axes, "µm"), dict.fromkeys(options.axes, "V"))
