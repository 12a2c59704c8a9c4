import math

from piezod.control.guard import Limits
from piezod.devices.interface import Sample
from piezod.experiment.virtual.open_loop import OpenLoopAxis

MS = 1_000_000
START_NS = 5 * MS
SLOW = Limits(0.0, 150.0, 2000.0)  # 2 V in a cycle


def test_open_loop_axis_drives_its_waveform_within_the_limits() -> None:
    """There is no command, and the sample is not used."""
    axis = OpenLoopAxis(lambda t_s: 1.0 + 1000 * t_s, SLOW, 0.0, START_NS, MS)
    invalid = Sample(0, math.nan, valid=False)

    first = axis.update(START_NS, invalid)
    axis.applied(first.drive_v)
    second = axis.update(START_NS + 9 * MS, invalid)

    assert first.drive_v == 1.0
    assert (second.drive_v, second.uncompensated_v, second.in_force_v) == (3.0, 10.0, 1.0)
    assert math.isnan(second.command_um)
