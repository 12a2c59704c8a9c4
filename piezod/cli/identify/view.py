"""The text of `piezod identify`."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from piezod.cli.identify.document import spread
from piezod.cli.identify.dynamics_view import in_ms, mode_line, print_delay
from piezod.cli.output import print_warnings
from piezod.experiment.fit.automatic import LARGEST_LOSS, Candidate, Choice
from piezod.experiment.fit.errors import Breakdown, Judgement
from piezod.experiment.fit.excitation import recommended_drive
from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.residuals import CLEAR_GAIN
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.smoothing import longest_window
from piezod.experiment.fit.verdict import verdict_of


def print_fit(
    console: Console, fitted: FileFit, model: Path | None, plot: Path | None, *, verbose: bool
) -> None:
    """Print the verdict, the doubts, the details if they are wanted, and the written files."""
    for line in verdict_of(fitted, written=model is not None).lines:
        console.print(line, soft_wrap=True)
    for each in fitted.understood:
        console.print(each, markup=False, soft_wrap=True)
    # The first misfit or question is in the verdict.
    print_warnings(console, (*fitted.misfits[1:], *fitted.questions[1:], *fitted.warnings))
    if verbose:
        console.print()
        _print_details(console, fitted)
    if model and plot:
        console.print(f"Model: {model}\nFigure: {plot}", soft_wrap=True)


def _print_details(console: Console, fitted: FileFit) -> None:
    """Print the record, the choice, the errors and their parts, and the recommended drive."""
    fit = fitted.chosen.fit
    console.print(_record(fitted.data, fitted.recorded), soft_wrap=True)
    if fitted.test_data:
        console.print(f"Test: {fitted.test_data}", soft_wrap=True)
    console.print(_smoothing(fit.settings, fitted.record))
    print_delay(console, fit.model.delay_s, fit.delay)
    if mode := mode_line(fitted):
        console.print(mode)
    if fitted.choice:
        _print_choice(console, fitted.choice)
    console.print(
        f"Model {_settings(fit.settings)}{_rate(fit)}{_path(fit)}. Error of the drive voltage "
        "predicted from the position, in % of its range:"
    )
    console.print(_errors(fitted, "voltage"))
    console.print("Error of the position predicted from the drive voltage, in % of its range:")
    console.print(_errors(fitted, "position"))
    for line in _offsets(fitted):
        console.print(line)
    console.print(_parts(fitted.parts))
    console.print(_uncertainty(fitted))
    _print_excitation(console, fitted)


def _record(data: Path, record: Record) -> str:
    length_s = record.t_s[-1] - record.t_s[0]
    text = f"{data}: {_count(record.t_s.size, 'sample')} at {1.0 / record.period_s:.6g} Hz, "
    text += f"{length_s:.4g} s"
    return f"{text}; the first {record.run_in_s:.3g} s are excluded" if record.run_in_s else text


def _smoothing(settings: FitSettings, record: Record) -> str:
    if settings.method is Method.LMS:
        return "The displacement is used as recorded, as in the paper's method."
    window = longest_window(record.drive_v)
    if window == 1:
        return "The displacement is used as recorded: the drive turns too sharply to smooth it."
    return (
        f"The displacement is smoothed over {window} samples, {in_ms(window * record.period_s)}, "
        "except at sharp turns of the drive."
    )


def _settings(settings: FitSettings) -> str:
    creep = ", with creep" if settings.creep else ""
    if settings.method is Method.SURFACE:
        return f"by {settings.method}, a smooth surface of loops{creep}"
    operators = _count(settings.order, "operator")
    return f"by {settings.method}, {operators} on each side, thresholds {settings.spacing}{creep}"


def _rate(fit: Fit) -> str:
    """Return how the loops widen with the rate of the drive, in words; empty if they do not."""
    share = fit.rate_lag
    return f", lag {100 * share:.2g} % of the drive's range per e-fold of its rate" if share else ""


def _path(fit: Fit) -> str:
    """Return what relaxes along the path of the drive, in words; empty if nothing does."""
    if fit.path is None:
        return ""
    way_pct = 100.0 / fit.path.decay
    return f", a part relaxes over {way_pct:.2g} % of the drive's range, up or down"


def _count(number: int, one: str) -> str:
    return f"{number} {one}" if number == 1 else f"{number} {one}s"


def _print_choice(console: Console, choice: Choice) -> None:
    table = _table()
    for heading in ("method", "thresholds", "creep"):
        table.add_column(heading)
    for heading in ("order", "parameters", "position", "voltage"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for each in choice.candidates:
        settings = each.fit.settings
        operators = settings.method is not Method.SURFACE
        mark = "taken" if each is choice.chosen else "best" if each is choice.best else ""
        table.add_row(
            settings.method,
            settings.spacing if operators else "–",
            "creep" if settings.creep else "",
            str(settings.order) if operators else "–",
            str(each.n_parameters),
            f"{each.validation.position_rms_pct:.3f}",
            f"{each.validation.rms_pct:.3f}",
            mark,
        )
    console.print(
        "Candidates, and the rms errors of position and voltage on blocks that were held out of "
        "the fit, in %:"
    )
    console.print(table)
    console.print(f"{_reason(choice)}\n")


def _reason(choice: Choice) -> str:
    """Return which model was taken, and why, in a sentence."""
    taken, best = choice.chosen, choice.best
    loss_pct = 100.0 * (LARGEST_LOSS - 1.0)
    text = f"Taken: {_candidate(taken)}, "
    if taken is not best:
        text += (
            f"because it is the simplest model whose errors of position and voltage are at most "
            f"{loss_pct:.0f} % larger than those of the best one, {_candidate(best)}, and by no "
            "more than chance explains"
        )
    else:
        text += (
            "because it predicts held-out positions and voltages best, and no simpler model is as "
            "good"
        )
    if choice.no_surface:
        text += f"; a surface {choice.no_surface}"
    elif not any(each.fit.settings.method is Method.SURFACE for each in choice.candidates):
        text += "; no surface could be fitted to this record"
    elif taken.fit.settings.method is Method.SURFACE and taken.fit.model.mode is None:
        text += (
            "; it has no first mode, because the record shows none that makes its errors on "
            f"held-out blocks smaller by {100.0 * (1.0 - CLEAR_GAIN):.0f} % or more"
        )
    return f"{text}."


def _candidate(candidate: Candidate) -> str:
    error_pct = candidate.validation.position_rms_pct
    return (
        f"{_settings(candidate.fit.settings).removeprefix('by ')} ({candidate.n_parameters} "
        f"parameters, position {error_pct:.3f} % rms)"
    )


def _numbers(errors: Mapping[str, float] | None, predicted: str) -> tuple[str, str]:
    """Return the worst and the rms error of the predicted quantity, voltage or position."""
    if errors is None:
        return "–", "–"
    return (
        f"{errors[f'{predicted}_error_max_pct']:.2f}",
        f"{errors[f'{predicted}_error_rms_pct']:.3f}",
    )


def _errors(fitted: FileFit, predicted: str) -> Table:
    table = _table()
    table.add_column("")
    judged = _judged(fitted)
    for name in judged:
        table.add_column(f"{name}:\nworst", justify="right")
        table.add_column("\nrms", justify="right")
    rows = {name: tuple(_rows(each)) for name, each in judged.items()}
    for row in zip(*rows.values(), strict=True):
        numbers = [number for _, errors in row for number in _numbers(errors, predicted)]
        table.add_row(row[0][0], *numbers)
    return table


def _table() -> Table:
    """Return an empty table with little space between its columns: the widest has 78 of 80."""
    return Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _judged(fitted: FileFit) -> dict[str, Judgement]:
    """Return the model, its counterpart with or without creep, and the fit to raw data, by name."""
    judged = {}
    for each in (fitted.chosen, fitted.other):
        if each:
            judged["with creep" if each.fit.settings.creep else "without creep"] = each
    if fitted.raw:
        judged["raw"] = fitted.raw
    return judged


def _parts(parts: Breakdown) -> str:
    """Return the parts of the residual of the position, in words."""
    at_hz = f" at {parts.vibration_hz:.4g} Hz" if parts.vibration_hz else ""
    drift_pct = parts.return_point_drift_pct
    drift = f" (by {drift_pct:.2f} % in all)" if drift_pct is not None else " (unknown)"
    rate = "" if parts.widening_pct is not None else " (unknown: all wide swings have one rate)"
    return (
        f"Residual of the position as recorded, without its mean: {parts.total_pct:.3f} % rms of "
        f"its range. Parts: drift of the return points{drift} {parts.drift_pct:.3f} %; rate of the "
        f"drive{rate} {parts.rate_pct:.3f} %; vibration{at_hz} {parts.vibration_pct:.3f} %; noise "
        f"{parts.noise_pct:.3f} %; the rest, mainly shapes of loops, {parts.rest_pct:.3f} %."
    )


def _uncertainty(fitted: FileFit) -> str:
    """Return the uncertainty of the model, in words."""
    uncertain, parts = fitted.uncertainty, []
    if uncertain.delay_s is not None:
        parts.append(f"delay ± {in_ms(uncertain.delay_s)}")
    if uncertain.creep_per_decade is not None:
        creep = fitted.chosen.fit.model.creep.per_decade
        parts.append(f"creep {100 * creep:.2f} ± {100 * uncertain.creep_per_decade:.2f} % a decade")
    band = spread(uncertain.band_pct)
    if band:
        parts.append(
            f"predicted voltage ± {band['rms_pct']:.2f} % rms, ± {band['max_pct']:.2f} % at worst"
        )
    text = f"Uncertainty due to noise (95 %): {'; '.join(parts)}. " if parts else ""
    blocks = spread(uncertain.spread_pct) or {}
    text += f"Models fitted without one of the blocks differ by {blocks['rms_pct']:.2f} % rms"
    apart = np.ptp(uncertain.block_creep_per_decade), np.ptp(uncertain.block_delay_s)
    if any(apart):
        text += f", in the creep by {100 * apart[0]:.2g} %, in the delay by {in_ms(apart[1])}"
    worst_pct = fitted.chosen.validation.worst_block_rms_pct
    return (
        f"{text}: that is what the model does not describe. On another drive expect errors of the "
        f"position as in the worst block, {worst_pct:.3g} % rms."
    )


def _print_excitation(console: Console, fitted: FileFit) -> None:
    if not fitted.missing_excitation:
        console.print("The record has swings of all sizes and speeds that the model needs.")
        return
    console.print("The record lacks:")
    for each in fitted.missing_excitation:
        console.print(f"- {each}")
    console.print("A drive that has all of it, for an experiment:\n")
    drive_v = fitted.chosen.fit.model.drive_v
    console.print(recommended_drive(*drive_v), markup=False, highlight=False, soft_wrap=True)


def _rows(judged: Judgement) -> Iterator[tuple[str, Mapping[str, float] | None]]:
    yield "train", judged.train
    yield f"{len(judged.validation.blocks)} blocks, held out", judged.validation.errors
    if judged.test and judged.test_offset_removed:
        yield "test", judged.test
        yield "test, no constant", judged.test_offset_removed.errors


def _offsets(fitted: FileFit) -> Iterator[str]:
    for name, judged in _judged(fitted).items():
        offset = judged.test_offset_removed
        if offset:
            yield (
                f"Constant offset removed from the test, {name}: {offset.offset_pct:+.2f} %, which "
                f"a shift of the displacement by {offset.offset_um:+.3g} µm would cause; "
                f"of the predicted position: {offset.position_offset_um:+.3g} µm."
            )
