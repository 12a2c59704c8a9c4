"""Text and document of `piezod response`."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from piezod.cli.output import new_console, new_table, print_json, print_warnings
from piezod.dynamics.fit_problem import RINGS_BELOW
from piezod.dynamics.model import Resonance
from piezod.experiment.response.judgement import described_pct
from piezod.experiment.response.outputs import Written, table_of, write_response
from piezod.records.response_record import ResponseRecord

_KINDS: Final = {True: "mode", False: "filter"}


def write_and_print(record: ResponseRecord, out: Path | None, *, json: bool) -> None:
    """Write the files of a measurement, if there is a path, and print it.

    Args:
        record: The measurement.
        out: Path of the response file; the others are written beside it. None for no files.
        json: Whether one JSON document is printed.
    """
    written = write_response(out, record, datetime.now(UTC)) if out else None
    if json:
        print_json(_document(record, written))
    else:
        _print(new_console(), record, written)


def _document(record: ResponseRecord, written: Written | None) -> dict[str, object]:
    fit = record.fit
    return {
        "axis": record.axis,
        "method": record.method,
        "rate_hz": record.rate_hz,
        "low_hz": fit.low_hz,
        "high_hz": fit.high_hz,
        "gains": [
            {
                "offset_v": about.offset_v,
                "amplitude_v": about.amplitude_v,
                "um_per_v": gain,
                "uncertainty_um_per_v": uncertain,
            }
            for about, (gain, uncertain) in zip(record.about, fit.gains, strict=True)
        ],
        "delay_s": fit.model.delay_s,
        "delay_uncertainty_s": fit.delay_uncertainty_s,
        "resonances": [
            {
                "kind": _kind(mode),
                "frequency_hz": mode.frequency_hz,
                "damping": mode.damping,
                "share": mode.share,
                "frequency_uncertainty_hz": uncertain[0],
                "damping_uncertainty": uncertain[1],
                "share_uncertainty": uncertain[2],
            }
            for mode, uncertain in zip(fit.model.resonances, fit.uncertainties, strict=True)
        ],
        "phase_deg": float(np.degrees(fit.phase_rad)),
        "creep_per_decade": float(np.log(10.0) * fit.creep),
        "described_pct": described_pct(fit),
        "criterion": {str(count): value for count, value in fit.criterion.items()},
        "lines": {name: column.tolist() for name, column in table_of(record).items()},
        "warnings": record.warnings,
        **({name: str(path) for name, path in written._asdict().items()} if written else {}),
    }


def _print(console: Console, record: ResponseRecord, written: Written | None) -> None:
    """Print gain, delay, modes, the range of the measurement, and the warnings."""
    console.print(_table(record))
    for sentence in _sentences(record):
        console.print(sentence)
    print_warnings(console, record.warnings)
    if written:
        response, table, figure = written
        console.print(f"Response: {response}\nTable: {table}\nFigure: {figure}", soft_wrap=True)
    else:
        console.print(
            "Nothing was written; --out response.yaml writes the model, a table and a figure."
        )


def _table(record: ResponseRecord) -> Table:
    fit = record.fit
    right = ("value", "uncertainty", "damping", "uncertainty", "share")
    table = new_table(f"axis {record.axis}", right=right, no_wrap=True)
    for about, (gain, uncertain) in zip(record.about, fit.gains, strict=True):
        name = f"gain about {about.offset_v:.4g} V"
        table.add_row(name, f"{gain:.4g} µm/V", f"{uncertain:.1g} µm/V")
    delay = (fit.model.delay_s, fit.delay_uncertainty_s)
    table.add_row("delay", *(f"{1e3 * each:.3g} ms" for each in delay))
    for mode, own in zip(fit.model.resonances, fit.uncertainties, strict=True):
        table.add_row(
            _kind(mode),
            f"{mode.frequency_hz:.5g} Hz",
            f"{own[0]:.1g} Hz",
            f"{mode.damping:.3g}",
            f"{own[1]:.1g}",
            f"{mode.share:.3g}",
        )
    return table


def _sentences(record: ResponseRecord) -> Iterator[str]:
    fit = record.fit
    used = sum(each.frequency_hz.size for each in fit.used)
    measured = sum(each.response.frequency_hz.size for each in record.about)
    amplitudes = ", ".join(f"{about.amplitude_v:.3g}" for about in record.about)
    coherence = np.concatenate([each.coherence for each in fit.used])
    yield (
        f"{used} of {measured} lines are clear of the noise, from {fit.low_hz:.4g} to "
        f"{fit.high_hz:.4g} Hz, with a coherence of {coherence.min():.3g} to "
        f"{coherence.max():.3g}. The amplitude was {amplitudes} V. The model describes the lines "
        f"to {described_pct(fit):.2g} % rms of the gain."
    )
    if all(_kind(mode) != _KINDS[True] for mode in fit.model.resonances):
        yield "There is no clear mode."
    yield (
        f"Modes above {0.5 * record.rate_hz:g} Hz, half of the rate, are out of reach. Without a "
        "filter before the sampling they appear folded below it: measure at another rate, too, if "
        "the sensor has none."
    )


def _kind(mode: Resonance) -> str:
    return _KINDS[mode.damping < RINGS_BELOW]
