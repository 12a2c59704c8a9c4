"""The compiled part of the compensator, which depends on the form of the model."""

from typing import Final, Protocol

from piezod.hysteresis.memory import FloatArray

NEXT: Final = 0
COMMAND: Final = 1
BEYOND: Final = 2
OUTSIDE: Final = 3
POSITION: Final = 4
CREPT: Final = 5
CARRIED: Final = 6
"""Indices of the array that carries values to the next step.

- NEXT: input to which the memory will advance if the drive was applied; NaN for none.
- COMMAND: the command, which is held if the next one is NaN.
- BEYOND: how far the requested drive lay outside the window; negative below it.
- OUTSIDE: how far the requested displacement lay outside the range; negative below it.
- POSITION: displacement of the hysteresis after the last drive that was applied.
- CREPT: creep then.

There are `CARRIED` of them.
"""


class CompensatorKernel(Protocol):
    """Makes one drive per cycle. It owns the hysteresis memory. Real-time safe.

    The weights and the lags of the creep, which it gets when it is made, change in place in each
    step. The memory advances in the next step, so that a drive that was not applied leaves no
    trace. All quantities are normalised.
    """

    #: (6,) values carried from step to step; always the same array.
    carried: FloatArray

    def step(
        self,
        target: FloatArray,
        share: float,
        strength: float,
        command: float,
        stretch: float,
        added: float,
        low: float,
        high: float,
        /,
    ) -> float:
        """Return the drive for a command.

        Args:
            target: (size,) weights that the weights in use approach.
            share: Share of the remaining distance that they move in this step.
            strength: 0 for a drive in proportion to the command, 1 for a compensated drive.
            command: Command in [0, 1]; clamped. NaN means no move.
            stretch: Factor of the command.
            added: Displacement that is added to the product, before the creep is subtracted.
            low: Lowest drive.
            high: Highest drive.
        """

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""
