"""The share of its error that an identifier removes in a sample: the pace of learning needs it."""

from piezod.config.axes import CompensatorConfig
from piezod.control.law.pace import RLS_SHARE
from piezod.hysteresis import ModelForm, StopForm, SurfaceForm, largest_stable_gain
from piezod.hysteresis.memory import FloatArray


def learned_share(settings: CompensatorConfig, form: ModelForm) -> float:
    """Return k, the share of its error that the identifier removes in a sample at pace 1."""
    match form:
        case StopForm(bank):
            return _of_stops(settings, bank)
        case SurfaceForm():
            return RLS_SHARE
        case _:
            raise TypeError(f"no identifier for a {type(form).__name__}")


def _of_stops(settings: CompensatorConfig, bank: FloatArray) -> float:
    match settings.identifier:
        case "rls":
            return RLS_SHARE
        case "nlms":
            return settings.lms_gain
        case "lms":  # it removes 2 γ ‖E - x‖², and its largest stable gain is 1 / ‖E - x‖²
            return 2.0 * settings.lms_gain / largest_stable_gain(bank)
