"""What `piezod experiment` with `play` prints: the errors of each play."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from piezod.cli.output import print_warnings
from piezod.config.play import PlayConfig, WaveConfig
from piezod.experiment.play.learn import LearnedPlay, PassReport
from piezod.experiment.play.task import left_out_share
from piezod.experiment.play.waves import PlayedExperiment, PlayedResult

_LEFT_OUT = 1e-3
"""Smallest share of the swing that is reported as left out."""
_MEANING = (
    "Errors in % of the swing of the command: measured, of the average of all periods that count{}."
    " Noise: rms, of that average."
)
_TRUE = "; true, of every sample"


def play_document(
    played: PlayedExperiment, play: PlayConfig, figures: Sequence[Path]
) -> dict[str, object]:
    """Return the document of `piezod experiment --json`."""
    return {
        "title": played.title,
        "seed": played.seed,
        "axes": {
            result.axis: {
                "response": {
                    "delay_s": result.response.model.delay_s,
                    "highest_hz": result.response.highest_hz,
                    "resonances": [
                        {"frequency_hz": one.frequency_hz, "damping": one.damping}
                        for one in result.response.model.resonances
                    ],
                },
                "waves": [
                    _wave_document(one, wave)
                    for one, wave in zip(result.plays, play.waves, strict=True)
                ],
                "notes": result.notes,
            }
            for result in played.axes
        },
        "figures": [str(path) for path in figures],
        "warnings": played.warnings,
    }


def _wave_document(play: LearnedPlay, wave: WaveConfig) -> dict[str, object]:
    return {
        "name": wave.name,
        "stopped": play.stopped,
        "best": play.best.label,
        "left_out_pct": 100.0 * left_out_share(play.given, play.command),
        "plays": [
            {
                "label": each.label,
                "measured": each.measured._asdict(),
                "true": each.true._asdict(),
                "limit": each.limit._asdict(),
                "noise_pct": each.noise_pct,
                "significant": each.significant,
            }
            for each in play.reports
        ],
        "reference": wave.reference,
        "reference_pct": wave.reference_pct,
    }


def print_play(console: Console, played: PlayedExperiment, play: PlayConfig, folder: Path) -> None:
    """Print the errors of each play, and what is remarkable."""
    true = any(one.best.knows_truth for result in played.axes for one in result.plays)
    for result in played.axes:
        console.print(_table(result, play.waves, several=len(played.axes) > 1, true=true))
    console.print(_MEANING.format(_TRUE if true else ""))
    for result in played.axes:
        console.print(_response(result))
        for one, wave in zip(result.plays, play.waves, strict=True):
            published = f" Published: {wave.reference}." if wave.reference else ""
            stopped = f"{wave.name}: {one.stopped}; best is {one.best.label}."
            console.print(f"{stopped}{_limit(one.best)}{published}")
        print_warnings(console, (*result.notes, *_left_out(result)))
    print_warnings(console, played.warnings)
    console.print(f"Figures and tables: {folder}", soft_wrap=True)


def _table(
    result: PlayedResult, waves: Sequence[WaveConfig], *, several: bool, true: bool
) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("\nplay", no_wrap=True)
    for kind in ("measured", "true") if true else ("measured",):
        for place, name in enumerate(("worst", "rms", "mean")):
            table.add_column(f"{'' if place else kind}\n{name}", justify="right", no_wrap=True)
    table.add_column("\nnoise", justify="right", no_wrap=True)
    for play, wave in zip(result.plays, waves, strict=True):
        name = f"{wave.name}, axis {result.axis}" if several else wave.name
        table.add_row(name, style="underline")
        for each in play.reports:
            cells = _cells(each, true=true)
            table.add_row(*cells, style="bold" if each is play.best else "")
        if wave.reference_pct:
            published = [_number(wave.reference_pct.get(key)) for key in ("max", "rms", "mean")]
            table.add_row("published", *published, style="italic")
        table.add_section()
    return table


def _cells(report: PassReport, *, true: bool) -> Iterator[str]:
    yield report.label
    for errors in (report.measured, report.true) if true else (report.measured,):
        yield from map(_number, errors)
    yield _number(report.noise_pct)


def _number(pct: float | None) -> str:
    return "" if pct is None else "–" if pct != pct else f"{pct:.3f}"  # noqa: PLR0124 - NaN


def _limit(best: PassReport) -> str:
    if not best.knows_truth:
        return ""
    calibration_pct, apart_pct = best.limit
    return (
        f" Limit: the sensor's calibration, {calibration_pct:.2f} %; apart from it the true error "
        f"is at most {apart_pct:.2f} %."
    )


def _response(result: PlayedResult) -> str:
    model = result.response.model
    modes = ", ".join(
        f"{one.frequency_hz:.4g} Hz (ζ {one.damping:.2g})" for one in model.resonances
    )
    return (
        f"Response of axis {result.axis}, known up to {result.response.highest_hz:.4g} Hz: delay "
        f"{1e6 * model.delay_s:.3g} µs, resonances {modes or 'none'}."
    )


def _left_out(result: PlayedResult) -> Iterator[str]:
    for play in result.plays:
        share = left_out_share(play.given, play.command)
        if share > _LEFT_OUT:
            yield (
                f"{play.given.name}: up to {100 * share:.2g} % of the swing are at frequencies at "
                "which the response is too small or not known well enough; the command is without "
                "them"
            )
