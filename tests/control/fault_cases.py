"""A moving stage on a rig that fails, and checks of its reaction."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine
from piezod.control.watch.sensor import STUCK_SWING
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.rig_stage import (
    SLEW_V_PER_S,
    FaultyStage,
    RigStage,
    cycles_until,
    has_left_run,
    quick_config,
)
from tests.control.surface_rig import with_model

SWING = rq.Wave(
    command_um={"x": Sine(kind="sine", low=0.0, high=20.0, frequency_hz=2.0)}, duration_s=1000.0
)
AT_REST = {State.SAFE, State.FAULT}
SLEW_STEP_V = SLEW_V_PER_S / quick_config().rate_hz + 1e-9
"""Largest step that the slew rate allows in a cycle, in V."""


class SwingingStage(FaultyStage):
    """A stage that follows a sine, and conditions and ramps quickly.

    The options are those of `FaultyStage` and its loop.
    """

    def __init__(
        self,
        mode: Mode = Mode.ADAPTIVE,
        model: str = "stops",
        *,
        strict_rt: bool = False,
        rate_hz: float | None = None,
        **options: Any,
    ) -> None:
        config = with_model(quick_config(), model)
        loop = config.loop.model_copy(update={"strict_rt": strict_rt})
        super().__init__(
            config.model_copy(update={"loop": loop, "rate_hz": rate_hz or config.rate_hz}),
            **options,
        )
        self.cycle()
        self.do(rq.Arm(confirm_output=True), rq.SelectMode(mode=mode), SWING)
        self.run(0.2)
        assert self.faults() == []


@dataclass(frozen=True, eq=False)
class FaultCase:
    """A fault, the first state after RUN, and the cycles within which it must come."""

    fault: str
    kind: InjectionKind
    arguments: dict[str, Any]
    state: State
    within_cycles: int
    name: str = ""


def run_case(case: FaultCase, model: str = "stops") -> tuple[SwingingStage, list[CycleRecord]]:
    """Return a stage after 0.5 s of a fault and at rest, and its records since the fault."""
    stage = SwingingStage(model=model)
    stage.fail(case.kind, 100, **case.arguments)
    after = stage.run(0.5)
    while len(after) < 1000 and (stage.state not in AT_REST or abs(stage.x.drive_v) >= 0.5):
        after.append(stage.cycle())
    return stage, after + stage.run(0.4)


def moved_from(after: Sequence[CycleRecord]) -> int:
    """Return the first cycle in which the drive has moved far enough to show a stuck sensor."""
    drive_v = [record.axes[0].drive_v for record in after]
    return next(i for i in range(len(after)) if np.ptp(drive_v[: i + 1]) > STUCK_SWING * 150.0)


def implausible_from(stage: RigStage, after: Sequence[CycleRecord]) -> int:
    """Return the first cycle with a position that no loop of the model explains at its voltage."""
    for i, record in enumerate(after):
        low_um, high_um = stage.stage.watches[0].sensor.allowed_um(record.axes[0].in_force_v)
        position_um = record.axes[0].position_um  # NaN if the sample was dropped
        if position_um < low_um or position_um > high_um:
            return i
    raise AssertionError("no position is implausible")


def check_course(
    case: FaultCase, stage: SwingingStage, after: list[CycleRecord], reaction: Reaction
) -> None:
    """Check that the fault was reported, RUN was left in time, and the stage ended at rest."""
    first = cycles_until(after, has_left_run) - 1
    visible = moved_from(after) if case.fault == Fault.S1 else 0
    reaction(case.fault, cycles=first + 1 - visible)
    assert case.fault in stage.faults()
    assert (after[first].state, first < case.within_cycles) == (case.state, True)
    assert all(record.state not in {State.RUN, State.IDENT} for record in after[first:])
    assert after[-1].state in AT_REST
    assert abs(after[-1].axes[0].drive_v) < 0.5
