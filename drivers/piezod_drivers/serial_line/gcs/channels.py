"""Which channels a PI controller has."""

from collections.abc import Sequence
from typing import Protocol

from piezod.devices.interface import ChannelUnits


class HasAxes(Protocol):
    """Options of either generation."""

    @property
    def axes(self) -> Sequence[str]:
        """Identifiers of the axes that the controller has."""
        ...


def channels(options: HasAxes) -> ChannelUnits:
    """Tell the channels: each axis has a position in µm and a voltage in V."""
    return ChannelUnits(dict.fromkeys(options.axes, "µm"), dict.fromkeys(options.axes, "V"))
