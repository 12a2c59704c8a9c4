"""The compiled part of the compensator, which depends on the form of the model."""

from typing import Protocol

from piezod.control.law.creep import CreepState
from piezod.control.law.step import StopKernel
from piezod.hysteresis import ModelForm, StopForm
from piezod.hysteresis.memory import FloatArray


class CompensatorKernel(Protocol):
    """Makes one drive per cycle. It owns the hysteresis memory. Real-time safe.

    The weights and the lags of the creep, which it gets when it is made, change in place in each
    step. The memory advances in the next step, so that a drive that was not applied leaves no
    trace. All quantities are normalised.
    """

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
    def position(self) -> float:
        """Displacement of the hysteresis after the last drive that was applied."""

    @property
    def beyond(self) -> float:
        """How far the last requested drive lay outside the window; negative below it."""

    @property
    def outside(self) -> float:
        """How far the last requested displacement lay outside the range; negative below it."""

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""


def new_kernel(form: ModelForm, weights: FloatArray, creep: CreepState) -> CompensatorKernel:
    """Return the kernel for a form, with a memory that has seen nothing but `creep.quick`.

    Args:
        form: Form of the model.
        weights: (form.size,) weights in use; they change in place.
        creep: Creep so far, and the displacement; its lags change in place.
    """
    match form:
        case StopForm(bank):
            return StopKernel(bank, weights, creep)
    raise TypeError(f"no compensator for a {type(form).__name__}")
