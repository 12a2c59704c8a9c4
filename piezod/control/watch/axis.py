"""All that watches one axis, put together."""

from typing import NamedTuple

from piezod.control.watch.adaptation import AdaptationWatch
from piezod.control.watch.amplifier import AmplifierWatch
from piezod.control.watch.bus import BusWatch
from piezod.control.watch.sensor import SensorWatch


class AxisWatch(NamedTuple):
    """The watches of one axis.

    Attributes:
        bus: Watches the way to the devices.
        sensor: Watches what is measured.
        amplifier: Watches what becomes of what is written.
        adaptation: Watches what is learned.
    """

    bus: BusWatch
    sensor: SensorWatch
    amplifier: AmplifierWatch
    adaptation: AdaptationWatch
