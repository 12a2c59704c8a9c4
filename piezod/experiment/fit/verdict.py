"""What to know first about a model: whether it can be used, its error, and what to do next."""

from enum import StrEnum
from typing import NamedTuple

from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.warnings import LARGE_PCT


class Usable(StrEnum):
    """Whether a model can be used."""

    YES = "yes"
    WITH_DOUBTS = "with doubts"
    ASK = "if the questions are answered"
    NO = "no"


class Verdict(NamedTuple):
    """Five sentences about a model."""

    usable: Usable
    position_rms_pct: float  #: Expected rms error of the position on another drive, in %.
    lines: tuple[str, ...]  #: The five sentences.


def verdict_of(fitted: FileFit, *, written: bool) -> Verdict:
    """Return the verdict about a model.

    Args:
        fitted: The model, and its fit.
        written: Whether the model is in a file.
    """
    usable = _usable(fitted)
    position_rms_pct, error = _error(fitted)
    lines = (_first(fitted, usable), error, _lacks(fitted), _doubts(fitted))
    return Verdict(usable, position_rms_pct, (*lines, _next(fitted, usable, written=written)))


def _usable(fitted: FileFit) -> Usable:
    if fitted.misfits:
        return Usable.NO
    if fitted.questions:
        return Usable.ASK
    if fitted.chosen.validation.position_rms_pct > LARGE_PCT:
        return Usable.NO
    return Usable.WITH_DOUBTS if fitted.warnings else Usable.YES


def _first(fitted: FileFit, usable: Usable) -> str:
    match usable:
        case Usable.NO if fitted.misfits:
            return f"Usable: no, the model is not that of the axis: it {fitted.misfits[0]}."
        case Usable.NO:
            return f"Usable: no, its errors are above {LARGE_PCT:g} % rms."
        case Usable.ASK:
            return f"Usable: only if this is answered: {fitted.questions[0]}"
        case _:
            return f"Usable: {usable}."


def _error(fitted: FileFit) -> tuple[float, str]:
    """Return the error of the position on another drive in %, and a sentence about it."""
    chosen = fitted.chosen
    travel_um, removed = chosen.fit.model.position_um.width, chosen.test_offset_removed
    if removed:
        rms_pct, worst_pct = (
            removed.errors[f"position_error_{which}_pct"] for which in ("rms", "max")
        )
        known = "as on the test, without a constant"
    else:
        # Motion unlike the rest of the record has errors as the block that is unlike the others.
        validation = chosen.validation
        rms_pct = validation.worst_block_rms_pct
        worst_pct = validation.errors["position_error_max_pct"]
        known = "as in the worst block that was held out of the fit"
    return rms_pct, (
        f"Error on another drive: about {rms_pct:.2g} % rms and {worst_pct:.2g} % at worst of "
        f"{travel_um:.4g} µm, {0.01 * rms_pct * travel_um:.2g} and "
        f"{0.01 * worst_pct * travel_um:.2g} µm, {known}."
    )


def _lacks(fitted: FileFit) -> str:
    if not fitted.missing_excitation:
        return "The record shows swings of all sizes and speeds that the model needs."
    return f"The record does not show: {' '.join(fitted.missing_excitation)}"


def _doubts(fitted: FileFit) -> str:
    told = bool(fitted.misfits) + bool(fitted.questions)  # in the first line
    count = len(fitted.misfits) + len(fitted.questions) + len(fitted.warnings) - told
    return f"Doubts: {count}, below." if count else f"Doubts: {'no others' if told else 'none'}."


def _next(fitted: FileFit, usable: Usable, *, written: bool) -> str:
    if fitted.misfits:
        return "Next: mend that, and identify again."
    if usable is Usable.NO:
        return "Next: check sensor, noise and units, and record again, more slowly."
    if usable is Usable.ASK:
        return (
            "Next: if the answer is yes, identify again with the option that the question names; "
            "if it is no, use the model."
        )
    if fitted.missing_excitation and (usable is Usable.WITH_DOUBTS or written):
        return (
            "Next: for smaller errors, record the drive that --verbose shows, and identify again; "
            "`piezod identify --live` does both."
        )
    if not written:
        return "Next: the same with --out MODEL.yaml writes the model and its figure."
    return "Next: name the file as `model:` of the axis, and run `piezod check` on its stage."
