"""Many points of a table in one compiled call."""

from typing import Any

from piezod.jit import compiled
from piezod.plant.kernel import Record, advance


@compiled
def play(
    first: int,
    last: int,
    sub_steps: int,
    command_v: float,
    commands_v: Any,
    ago: float,
    readings_v: Any,
    truths_um: Any,
    state: Record,
    constants: Record,
) -> None:
    """Advance point by point; store reading and displacement at each, then change the command.

    Args:
        first: First point.
        last: Point after the last one.
        sub_steps: Sub-steps before each point; the noise for all must have been drawn.
        command_v: Command before the first point, in V.
        commands_v: (n,) command from each point on, in V.
        ago: Age of the reported light, in sub-steps.
        readings_v: (n,) reading of the sensor's converter at each point, in V; filled.
        truths_um: (n,) displacement at each point, in µm; filled.
        state: State of the plant.
        constants: Constants of the plant.
    """
    for k in range(first, last):
        readings_v[k] = advance(sub_steps, command_v, ago, state, constants)
        truths_um[k] = state[0].displacement_um
        command_v = commands_v[k]
