"""The watches of one axis, in one tuple."""

from typing import NamedTuple

from piezod.control.watch.absent_sensor import AbsentSensor
from piezod.control.watch.adaptation import AdaptationWatch
from piezod.control.watch.amplifier import AmplifierWatch
from piezod.control.watch.bus import BusWatch
from piezod.control.watch.sensor import SensorWatch


class AxisWatch(NamedTuple):
    """The watches of one axis."""

    bus: BusWatch  #: Watches the buses to the devices of the axis.
    sensor: SensorWatch | AbsentSensor  #: Watches the samples.
    amplifier: AmplifierWatch  #: Watches the writes and the read-back.
    adaptation: AdaptationWatch  #: Watches the identifier and the loop that it closes.
