"""A population of thermally activated relays, compiled.

Relay (i, j) has the thresholds α and β in cell i and j of the range of the drive. It is up in the
fraction p of an ensemble, and switches with the rates

    up: ν·exp((u - α)/w),   down: ν·exp((β - u)/w)

which is ν·exp((|h| - hc)/w) with h = u - (α+β)/2 and hc = (α-β)/2. The faster the drive, the later
a relay switches: by w·ln(10) for each decade of speed.

One call advances all relays by a sub-step at the drive in its middle, by the implicit Euler rule: a
rate that is fast in a sub-step gives the equilibrium, so that no shorter step is needed. The
exponentials are products of one that depends on i and one that depends on j, so a sub-step takes
two for each cell.
"""

from math import exp
from typing import Any, Final, TypeAlias

import numpy as np

from piezod.jit import compiled
from piezod.plant.laws import Array, ExponentialDensity, ThermalRelays

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

RELAYS: Final = 3
CELLS: Final = 40

_LONG_AGO_S: Final = 1e4
_TRAVEL_S: Final = 0.1  # the travel is the displacement 0.1 s after a step


@compiled
def relax(unit: float, state: Record, constants: Record) -> float:
    """Let the relays switch during one sub-step and return the part of the displacement.

    Args:
        unit: Drive in the middle of the sub-step, in nominal drives.
        state: State of the plant.
        constants: Constants of the plant.

    Returns:
        Displacement of the relays since rest, 1 at the nominal drive.
    """
    s, c = state[0], constants[0]
    up, down, weight = s.up, s.relays_down, c.relay_weight
    for j in range(CELLS):
        down[j] = c.attempts * exp((c.cell[j] - unit) / c.activation)
    total = -c.part_at_rest
    for i in range(CELLS):
        rise = c.attempts * exp((unit - c.cell[i]) / c.activation)
        fall = 1.0 / c.spread[i]
        for j in range(i + 1):
            to_up = rise * c.spread[j]
            up[i, j] = (up[i, j] + to_up) / (1.0 + to_up + fall * down[j])
            total += weight[i, j] * up[i, j]
    s.part = total
    return float(total)


def relay_constants(
    law: ThermalRelays, step_s: float, lowest: float, highest: float
) -> dict[str, Any]:
    """Return the constants of a stage that came from its highest drive to 0 long ago.

    Args:
        law: Parameters.
        step_s: Sub-step in s.
        lowest: Lowest drive, in nominal drives.
        highest: Highest drive, in nominal drives.
    """
    size = (highest - lowest) / CELLS
    cell = lowest + size * (np.arange(CELLS) + 0.5)
    # Thresholds on a plain grid would all switch at 40 drives. The golden ratio spreads those of a
    # row evenly over its cell.
    offset = size * ((np.arange(CELLS) + 0.5) * (np.sqrt(5) - 1) / 2 % 1 - 0.5)
    spread = np.exp(-offset / law.activation)
    upper, lower = cell[:, None], cell[None, :]
    width, middle = np.maximum(upper - lower, size / 3), (upper + lower) / 2
    density = ExponentialDensity(decay=law.decay).density(width, middle)
    weight = np.tril(density)
    weight[np.diag_indices(CELLS)] /= 2  # half of such a cell is below the diagonal

    def relaxed(up: Array, unit: float, duration_s: float) -> Array:
        """Return the relays after some time at a constant drive, exactly."""
        to_up = law.attempts_hz * np.exp((unit - cell[:, None]) / law.activation) * spread
        to_down = law.attempts_hz * np.exp((cell - unit) / law.activation) / spread[:, None]
        settled = to_up / (to_up + to_down)
        left = np.exp(-(to_up + to_down) * duration_s)
        return np.asarray(settled + (up - settled) * left)

    at_rest = relaxed(np.ones_like(weight), 0.0, _LONG_AGO_S)
    part_at_rest = np.sum(weight * at_rest)
    nominal = np.sum(weight * relaxed(at_rest, 1.0, _TRAVEL_S)) - part_at_rest
    return {
        "attempts": law.attempts_hz * step_s,
        "activation": law.activation,
        "cell": cell,
        "spread": spread,
        "relay_weight": weight / nominal,
        "relays_at_rest": np.tril(at_rest),
        "part_at_rest": part_at_rest / nominal,
    }
