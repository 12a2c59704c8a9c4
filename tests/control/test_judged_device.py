"""Tests of an output of its own, and of the judge of the voltage on the stage."""

from math import nan

import pytest

from piezod.control.guard import Limits
from piezod.devices.wiring import construct, pairs_of
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from tests.control.judged_device import JudgedDevice
from tests.control.own_output import OutputFault, OutputKind
from tests.control.rig_stage import shipped_config

PERIOD_NS = NS_PER_S // 20
LIMITS = Limits(0.0, 150.0, 400.0)
BEGINS, ENDS = 5, 15


class Rig:
    """A judged rig at 60 V, in cycles of 50 ms."""

    def __init__(self, kind: OutputKind, value: float = nan) -> None:
        config = shipped_config()
        (made,) = construct(config.devices, pairs_of(config.axes), config.seed).values()
        assert isinstance(made, SimulatedRig)
        self.device, self.cycles = JudgedDevice(made, LIMITS, PERIOD_NS), 0
        self.device.open()
        self.device.activate(0)
        fault = OutputFault(kind, BEGINS * PERIOD_NS, ENDS * PERIOD_NS, value)
        self.device.output.faults.append(fault)
        for drive_v in (20.0, 40.0, 60.0):
            self.cycle(drive_v)

    def cycle(self, drive_v: float | None) -> tuple[float, float]:
        """Read back, and write if there is a voltage; return read-back and output in V."""
        self.cycles += 1
        t_ns = self.cycles * PERIOD_NS
        (read_back_v,) = self.device.read_back(t_ns)
        output_v = self.device.output.output_v(t_ns)
        if drive_v is not None:
            assert self.device.write([drive_v], t_ns)
        return read_back_v, output_v

    def until(self, cycle: int, drive_v: float | None) -> tuple[float, float]:
        """Run until after a cycle; return read-back and output of the last, in V."""
        while self.cycles < cycle:
            seen = self.cycle(drive_v)
        return seen


@pytest.mark.parametrize(
    ("kind", "value", "during_v", "after_v"),
    [
        (OutputKind.STUCK, nan, (60, 60), (70, 70)),
        (OutputKind.SCALED, 0.6, (42, 42), (70, 70)),
        (OutputKind.SCALED, 1.3, (91, 91), (70, 70)),
        (OutputKind.LATE, 0.2, (70, 70), (70, 70)),
        (OutputKind.LATE, 1.0, (60, 60), (70, 70)),
        (OutputKind.SLOW, 0.05, (70, 70), (70, 70)),
        (OutputKind.OFF, nan, (0, 0), (70, 70)),
        (OutputKind.ELSEWHERE, 40.0, (0, 0), (40, 40)),
        (OutputKind.FROZEN_READ_BACK, nan, (60, 70), (70, 70)),
        (OutputKind.FALSE_READ_BACK, 10.0, (10, 70), (70, 70)),
        (OutputKind.SHIFTED_READ_BACK, -5.0, (65, 70), (70, 70)),
        (OutputKind.SCALED_READ_BACK, 0.5, (35, 70), (70, 70)),
        (OutputKind.LATE_READ_BACK, 1.0, (60, 70), (70, 70)),
    ],
)
def test_output_and_read_back_fail_on_their_own(
    kind: OutputKind, value: float, during_v: tuple[float, float], after_v: tuple[float, float]
) -> None:
    """Read-back and output are as the fault says, and right again after it."""
    rig = Rig(kind, value)
    rig.until(BEGINS, 60.0)
    during = rig.until(ENDS - 1, 70.0)
    rig.cycle(None)  # the output needs some milliseconds
    after = rig.cycle(None)

    assert during == pytest.approx(during_v, abs=0.3)
    assert after == pytest.approx(after_v, abs=0.3)


@pytest.mark.parametrize(
    ("kind", "value", "drive_v", "found"),
    [
        (OutputKind.STUCK, nan, 80.5, 0),
        (OutputKind.STUCK, nan, 81.0, 1),
        (OutputKind.LATE, 1.0, 39.0, 1),
        (OutputKind.OFF, nan, 60.0, 0),  # the amplifier has done it: a time to believe it is left
        (OutputKind.FALSE_READ_BACK, 10.0, 60.0, 0),
        (OutputKind.FALSE_READ_BACK, 10.0, 10.0, 1),
    ],
)
def test_write_far_from_the_output_is_found(
    kind: OutputKind, value: float, drive_v: float, found: int
) -> None:
    """A write may be a cycle of the slew rate and the tolerance, 20.75 V, from the output."""
    rig = Rig(kind, value)
    rig.until(BEGINS, 60.0)
    rig.cycle(drive_v)

    assert len(rig.device.violations) == found, rig.device.violations


def test_old_write_may_not_wait_for_an_output_that_fell() -> None:
    """An output is off for 2 s while its last write is repeated: in the end that is a violation."""
    rig = Rig(OutputKind.OFF)
    rig.device.output.faults[:] = [OutputFault(OutputKind.OFF, BEGINS * PERIOD_NS, 2 * NS_PER_S)]
    rig.until(BEGINS + 20, 60.0)
    early = len(rig.device.violations)
    rig.until(BEGINS + 30, 60.0)

    assert early == 0
    assert len(rig.device.violations) == 1


@pytest.mark.parametrize("known", [True, False])
def test_write_that_nobody_can_judge_is_apart(known: bool) -> None:
    """A new process knows of no write: a false read-back without a sensor proves nothing."""
    rig = Rig(OutputKind.FALSE_READ_BACK, 10.0)
    rig.until(BEGINS, 60.0)
    if not known:
        rig.device.forget()
    rig.cycle(10.0)

    assert len(rig.device.violations) == known
    assert rig.device.apart == (not known)
