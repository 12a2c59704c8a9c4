"""Tests that a changed stage is learned again within seconds."""

from typing import NamedTuple

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.hysteresis.memory import FloatArray
from piezod.plant.plant import Plant
from piezod.plant.preisach import everett
from tests.conftest import Figure
from tests.experiment.stress_rig import (
    CYCLE_S,
    Identified,
    StressRig,
    listed,
    swing_um,
    worst_by_cycle_pct,
)

BOTTOM_S = 0.75 * CYCLE_S
"""Time at which the swing turns upwards: there a change of gain makes no large jump."""
WITHIN_S = 10.0
AFTER_S = 20.0


class Change(NamedTuple):
    """How a stage changes."""

    gain: float  #: Part by which the displacement grows.
    hysteresis: float  #: Part by which its irreversible part grows.
    #: Whether the reversible part shrinks so that full swings stay as large.
    keeps_travel: bool = False


CHANGES = {
    "gain +10 %": Change(0.1, 0.0),
    "hysteresis +20 %": Change(0.0, 0.2),
    "hysteresis +20 % at the same travel": Change(0.0, 0.2, keeps_travel=True),
    "gain +10 %, hysteresis +20 %": Change(0.1, 0.2),
}
BOTH = "gain +10 %, hysteresis +20 %"


def change_hysteresis(plant: Plant, change: Change) -> None:
    """Change the parts of a Preisach stage, without a jump of its displacement."""
    constants, state = plant._constants, plant._state[0]  # noqa: SLF001 - a fault inside of it
    more = change.hysteresis * constants["irreversible"]
    constants["irreversible"] += more
    constants["reversible"] -= change.keeps_travel * more

    def way(start: float, end: float) -> float:
        rise: float = everett(max(start, end), min(start, end), constants)
        return rise if end > start else -rise

    depth, at, value = int(state["depth"]), state["turn_at"], state["turn_value"]
    for k in range(1, depth):
        value[k] = value[k - 1] + way(at[k - 1], at[k])
    here = value[depth - 1] + way(at[depth - 1], float(state["unit"]))
    value[:depth] += float(state["hysteretic"]) - here


def errors_of(stage: Identified, change: Change, mode: Mode) -> tuple[FloatArray, FloatArray]:
    """Return the worst true errors of the swings before and after a change, in %."""
    axis = stage.config.axes["x"]
    wide = axis.compensator.model_copy(update={"learned_pct": 30.0})
    axes = {"x": axis.model_copy(update={"compensator": wide})}
    config = stage.config.model_copy(update={"axes": axes})
    rig = StressRig(stage._replace(config=config), swing_um, mode)
    rig.run(BOTTOM_S)
    rate_hz = stage.config.rate_hz
    before = worst_by_cycle_pct(rig.run(3.0 * CYCLE_S), rate_hz)
    rig.channels.gain += change.gain
    change_hysteresis(rig.plant, change)
    return before, worst_by_cycle_pct(rig.run(AFTER_S), rate_hz)


@pytest.mark.parametrize(
    "name",
    [BOTH, *(pytest.param(name, marks=pytest.mark.stress) for name in CHANGES if name != BOTH)],
)
def test_changed_stage_is_learned(beyond_stage: Identified, figure: Figure, name: str) -> None:
    """The true error is below 1 % in every swing from 10 s after the change on."""
    before, after = errors_of(beyond_stage, CHANGES[name], Mode.ADAPTIVE)
    figure(f"{name}: worst true error in full swings {listed(before)}, then {listed(after)} %")

    assert np.max(before) < 1.0
    assert np.max(after[round(WITHIN_S / CYCLE_S) :]) < 1.0


@pytest.mark.stress
def test_change_matters_without_adaptation(beyond_stage: Identified, figure: Figure) -> None:
    """Without adaptation the error grows by much of the change, and stays."""
    before, after = errors_of(beyond_stage, CHANGES[BOTH], Mode.FEEDFORWARD)
    figure(f"{BOTH}, feedforward: {listed(before)}, then {listed(after)} %")

    assert np.max(before) < 1.0
    assert np.min(after) > 10.0
