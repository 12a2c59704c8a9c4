"""All that watches one axis, put together."""

from typing import NamedTuple

from piezod.control.adaptation_watch import AdaptationWatch
from piezod.control.amplifier_watch import AmplifierWatch
from piezod.control.bus_watch import BusWatch
from piezod.control.sensor_watch import SensorWatch


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
