"""Text and document of `piezod replay`."""

from math import isnan
from pathlib import Path
from typing import Final

from rich.console import Console

from piezod.cli.output import new_table, print_warnings
from piezod.config.modes import Mode
from piezod.experiment.replay.comparison import Comparison

_STAND_IN: Final = {
    "replayed": "The replayed model describes this recording better than stops that are fitted to "
    "it, and says",
    "fitted": "Stops that are fitted to this recording describe it better than the replayed model, "
    "and say",
}


def as_document(
    recording: Path,
    axis: str,
    model: Path | None,
    mode: Mode | None,
    compared: Comparison,
    figure: Path | None,
) -> dict[str, object]:
    """Return the document of `piezod replay --json`."""
    return {
        "recording": str(recording),
        "axis": axis,
        "model": str(model) if model else None,
        "mode": mode.value if mode else None,
        "repeats": compared.repeats,
        "stand_in": compared.stand_in,
        "stand_in_rms_um": compared.stand_in_um,
        "modes": [row._asdict() for row in compared.rows],
        "verdict": _verdict(model, mode, compared),
        "warnings": compared.warnings,
        "figure": str(figure) if figure else None,
    }


def print_comparison(
    console: Console,
    model: Path | None,
    mode: Mode | None,
    compared: Comparison,
    figure: Path | None,
) -> None:
    """Print the errors of each mode, the verdict and the warnings."""
    right = ("time", "error", "", "replay", "", "drive")
    table = new_table("recorded\nmode", right=right, no_wrap=True)
    table.add_row("", "s", "rms µm", "worst", "rms µm", "worst", "rms V")
    for row in compared.rows:
        errors = row.recorded_rms_um, row.recorded_worst_um, row.rms_um, row.worst_um
        numbers = (f"{error_um:.3f}" for error_um in errors)
        table.add_row(row.recorded, f"{row.duration_s:.1f}", *numbers, f"{row.drive_rms_v:.3f}")
    console.print(table)
    console.print(_verdict(model, mode, compared))
    print_warnings(console, compared.warnings)
    if figure:
        console.print(f"Figure: {figure}", soft_wrap=True)


def _verdict(model: Path | None, mode: Mode | None, compared: Comparison) -> str:
    worst_v = max(row.drive_worst_v for row in compared.rows)
    if compared.repeats:
        return f"The replay repeats the recording: the drives differ by at most {worst_v:.2g} V."
    if model is None and mode is None:
        return (
            f"The replay does not repeat the recording: the drives differ by up to {worst_v:.3g} "
            "V. Something that the file does not have made a difference: the hysteresis memory or "
            "what was learned before it, a model that was adopted meanwhile, another version."
        )
    certain = (
        "The recording does not support a model of the stage: the errors are those of the model "
        "that was replayed."
        if isnan(compared.stand_in_um)
        else f"{_STAND_IN[compared.stand_in]} what the other voltages would have done. The error "
        f"there is {compared.stand_in_um:.3f} µm rms; smaller differences mean nothing."
    )
    replayed = " and ".join(
        filter(None, (f"with {model}" if model else "", f"in mode {mode.value}" if mode else ""))
    )
    return f"The errors of the replay, {replayed}, are estimates. {certain}"
