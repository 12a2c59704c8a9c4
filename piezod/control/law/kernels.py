"""Chooses the compiled part of the compensator for the form of a model."""

from piezod.control.law.creep import CreepState
from piezod.control.law.kernel import CompensatorKernel
from piezod.control.law.step import StopKernel
from piezod.control.law.surface_step import SurfaceKernel
from piezod.hysteresis import ModelForm, StopForm, SurfaceForm
from piezod.hysteresis.memory import FloatArray


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
        case SurfaceForm():
            return SurfaceKernel(form, weights, creep)
    raise TypeError(f"no compensator for a {type(form).__name__}")
