"""The figure of `drivers/README.md`: the hysteresis of the simulated stages."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from piezod.hysteresis.memory import FloatArray
from piezod.plant.effects import EFFECTS, without
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from piezod.records.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    house_style,
    new_figure,
)
from piezod.units import NS_PER_S

_SHOWN: Final = {
    "stack": BLACK,
    "preisach-exponential": BLUE,
    "preisach-gaussian": GREEN,
    "preisach-asymmetric": ORANGE,
    "thermal-relays": PURPLE,
    "bouc-wen": VERMILLION,
    "dahl": GREY,
}
_SWINGS: Final = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_HALF: Final = 500  # samples of a branch; a loop takes 1 s
_SETTLE: Final = 60  # loops before the shown one; small loops of Bouc-Wen and Dahl settle slowly


@house_style()
def stages_figure() -> Figure:
    """Draw the full loop of each class, without its mean slope, and its width over the swing."""
    figure = new_figure(10.0, 4.6, "Hysteresis of the simulated stages, nominal, at 1 Hz", "")
    loops, widths = figure.subplots(1, 2)
    for variant, colour in _SHOWN.items():
        drive, position = _loop(variant, 1.0)
        bent = np.append(position - drive, position[0] - drive[0])
        loops.plot(100 * np.append(drive, drive[0]), 100 * bent, color=colour, linewidth=1.2)
        width_pct = [_width_pct(variant, swing) for swing in _SWINGS]
        widths.plot(100 * np.array(_SWINGS), width_pct, color=colour, label=variant, marker=".")
    loops.set(xlabel="drive, % of nominal", ylabel="% of the loop")
    loops.set_title("Full loop: displacement minus straight line")
    widths.set(xlabel="swing around the middle, % of nominal", ylabel="% of its displacement")
    widths.set_title("Width of a loop")
    widths.set_ylim(bottom=0)
    widths.legend(loc="lower right")
    return figure


def _loop(variant: str, swing: float) -> tuple[FloatArray, FloatArray]:
    """Return drive and displacement of a settled loop around the middle, both from 0 to 1."""
    nominal = VARIANTS[variant].parameters
    plant = Plant(
        without(nominal, sorted(set(EFFECTS) - {"hysteresis", "asymmetry"})),
        np.random.SeedSequence(1),
    )
    cycle = 1 - np.abs(np.arange(1, 2 * _HALF + 1) / _HALF - 1)
    position = []
    for unit in np.tile(cycle, _SETTLE + 1):
        plant.command(nominal.stage.drive_v * float(0.5 + swing * (unit - 0.5)))
        plant.advance_to(plant.now_ns + NS_PER_S // (2 * _HALF))
        position.append(plant.true_displacement_um)
    last = np.array(position[-2 * _HALF :])
    return cycle, (last - last.min()) / np.ptp(last)


def _width_pct(variant: str, swing: float) -> float:
    _, position = _loop(variant, swing)
    rising, falling = position[: _HALF - 1], position[_HALF:-1][::-1]
    return float(100 * np.max(falling - rising))
