"""A voltage that was sent and not acknowledged may be in force after a loss."""

import pytest

from piezod.config.states import State
from piezod.devices.status import DeviceFlag
from piezod.testing.injections import InjectionKind as K
from tests.control.fault_cases import SwingingStage


def lost_after(taken: int, refused: int) -> tuple[SwingingStage, float]:
    """Return a stage that was lost after writes without acknowledgement, and the last one with it.

    Its sensor is silent then, so that only read-back and writes tell the voltage.

    Args:
        taken: Number of writes that the output followed.
        refused: Number of writes after them that it did not follow.
    """
    stage = SwingingStage()
    while not 20.0 < stage.x.drive_v < 25.0:
        stage.cycle()
    acknowledged_v = stage.x.drive_v
    for kind, cycles in ((K.UNACKNOWLEDGED, taken), (K.REFUSED, refused)):
        stage.fail(kind, cycles)
        for _ in range(cycles):
            stage.cycle()
    stage.fail(K.DROPPED)
    stage.fail(K.LOST, 100, flag=DeviceFlag.DISCONNECTED)
    stage.cycle()
    assert stage.state == State.BLIND
    return stage, acknowledged_v


@pytest.mark.parametrize(("taken", "refused"), [(1, 0), (4, 0), (1, 2), (2, 1)])
def test_stage_returns_from_a_voltage_that_was_not_acknowledged(taken: int, refused: int) -> None:
    """The read-back shows one of the voltages that were sent: the ramp to rest begins there."""
    stage, acknowledged_v = lost_after(taken, refused)
    there_v = stage.channels.writes[-1][1][0]
    stage.channels.writes.clear()
    stage.until("FAULT")

    assert abs(there_v - acknowledged_v) > 0.75  # the tolerance of the read-back
    assert abs(stage.channels.writes[0][1][0] - there_v) < 4.75
    assert stage.output_v == pytest.approx(0.0, abs=0.01)


def test_read_back_that_no_write_explains_is_not_believed() -> None:
    """It is on the other side of the last acknowledged write: nothing is written."""
    stage, _ = lost_after(2, 0)
    stage.fail(K.READ_BACK_OFFSET, value=30.0)
    stage.channels.writes.clear()
    stage.until("FAULT")

    assert stage.channels.writes == []
