"""What to know first about a model: whether it can be used, its error, and what to do next."""

from enum import StrEnum
from typing import Final, NamedTuple

from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.warnings import LARGE_PCT

NEW_DRIVE: Final = 1.4
"""Ratio of the errors on another drive and on held-out blocks, measured on simulated stages."""


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
    large = fitted.chosen.validation.position_rms_pct > LARGE_PCT
    return Usable.WITH_DOUBTS if fitted.warnings or large else Usable.YES


def _first(fitted: FileFit, usable: Usable) -> str:
    match usable:
        case Usable.NO:
            return f"Usable: no, the model is not that of the axis: it {fitted.misfits[0]}."
        case Usable.ASK:
            return f"Usable: only if this is answered: {fitted.questions[0]}"
        case _:
            return f"Usable: {usable}."


def _error(fitted: FileFit) -> tuple[float, str]:
    """Return the error of the position on another drive in %, and a sentence about it."""
    chosen, travel_um = fitted.chosen, fitted.chosen.fit.model.position_um.width
    removed = chosen.test_offset_removed
    held_out = chosen.validation.errors
    errors = removed.errors if removed else held_out
    factor = 1.0 if removed else NEW_DRIVE
    rms_pct = factor * errors["position_error_rms_pct"]
    worst_pct = factor * errors["position_error_max_pct"]
    known = "as measured on the test" if removed else f"{NEW_DRIVE:g} times that of held-out blocks"
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
    doubts = (*fitted.misfits, *fitted.questions, *fitted.warnings)
    if not doubts:
        return "Doubts: none."
    return f"Doubts: {len(doubts)}, below."


def _next(fitted: FileFit, usable: Usable, *, written: bool) -> str:
    if usable is Usable.NO:
        return "Next: mend that, and identify again."
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
