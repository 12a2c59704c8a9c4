"""The work of `piezod scan`."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

import typer

from piezod.cli.interrupt import unwinding
from piezod.cli.output import print_json
from piezod.cli.paths import check_writable
from piezod.cli.progress import progress_bar, report_part
from piezod.client import StageClient
from piezod.config.experiment import load_experiment
from piezod.config.scan import AnyScan, load_scan
from piezod.devices import registry
from piezod.experiment.live.scan import scan_live
from piezod.experiment.play.learn import PassReport
from piezod.experiment.scan.learn import FrameReport
from piezod.experiment.scan.pixels import PixelErrors
from piezod.experiment.scan.run import ScanResult, ScanSetting, Told
from piezod.experiment.virtual.scan import scan_virtually
from piezod.records.new_name import free_name
from piezod.records.scan_file import SweptPixels

ENDING: Final = ".nxs"
_MOST_SHOWN: Final = 96
"""Largest number of rows, and of columns, that a program is told while a scan runs."""

Connect = Callable[[], AbstractContextManager[StageClient]]


def run(
    file: Path,
    out: Path | None,
    seed: int | None,
    tables: Path | None,
    connect: Connect | None,
    *,
    json: bool,
) -> None:
    """Run a scan and print its errors.

    Args:
        file: Its description.
        out: The file to write; None for the default.
        seed: Seed of the devices; None for that of the file.
        tables: Folder of learned lines; None for none.
        connect: Connects to a running stage; None for virtual time.
        json: Whether one JSON document is printed.
    """
    path = free_name(out or Path(f"{file.stem}{ENDING}"))
    check_writable(path.parent)
    setting = ScanSetting(path, file.read_text(encoding="utf-8-sig"), tables)
    with progress_bar() as progress:
        told = _Teller(progress, quiet=json).told
        if connect is not None:
            scan = load_scan(file)
            _check_tables(scan, tables)
            with unwinding(), connect() as client:
                result = scan_live(client, scan, setting, told)
        else:
            config = load_experiment(file, registry)
            wanted = config.scan
            if wanted is None:
                raise typer.BadParameter(f"{file} has no `scan:`", param_hint="FILE")
            _check_tables(wanted, tables)
            if seed is not None:
                config = config.model_copy(update={"seed": seed})
            result = scan_virtually(config, wanted, setting, told)
    if json:
        print_json(_document(result))
    else:
        typer.echo(f"Scan: {result.file}; `piezod plot {result.file}` draws it.")


def _check_tables(scan: AnyScan, tables: Path | None) -> None:
    if tables is not None and scan.mode is not None:
        message = f"only without `mode` (got {scan.mode}): the loop needs no table"
        raise typer.BadParameter(message, param_hint="'--tables'")


class _Teller:
    """Tells people, and programs, how a scan goes on."""

    def __init__(self, progress: Callable[[str, float], None], *, quiet: bool) -> None:
        self._progress, self._quiet = progress, quiet
        self.told = Told(self._line, self._frame, self._sweep, self._note)
        progress("resting, and measuring responses", 0.0)

    def _line(self, done: PassReport) -> None:
        self._progress(f"line, {done.label}", 0.0)
        worst, rms, _ = done.measured
        text = f"line, {done.label:22} max {worst:6.3f}  rms {rms:6.3f}  % of the swing, measured"
        self._say({"line": done.label, **done.measured._asdict()}, text)

    def _frame(self, done: FrameReport) -> None:
        self._progress(done.label, 0.0)
        self._say(_frame_document(done), "\n".join(_frame_lines(done)))

    def _sweep(self, swept: SweptPixels, share: float, rows: int) -> None:
        self._progress("the frame that is stored", share)
        each = 1 + (rows - 1) // _MOST_SHOWN
        if swept.row % each:
            return
        step = 1 + (swept.error_um.size - 1) // _MOST_SHOWN
        values = (swept.inputs[:, 0] if swept.inputs.size else swept.error_um)[::step]
        shown = values[::-1] if swept.backward else values
        report_part(
            {
                "row": swept.row,
                "place": swept.row // each,
                "backward": swept.backward,
                "values": [float(f"{value:.4g}") for value in shown.tolist()],
            }
        )

    def _note(self, text: str) -> None:
        if not report_part({"note": text}):
            typer.echo(text, err=True)

    def _say(self, document: dict[str, object], text: str) -> None:
        report_part(document)
        if not self._quiet:
            typer.echo(text)


def _frame_lines(done: FrameReport) -> list[str]:
    lines = [_errors_line(f"{done.label}, measured", done.measured)]
    if done.knows_truth:
        lines.append(_errors_line(f"{done.label}, true", done.true))
    return lines


def _errors_line(label: str, errors: PixelErrors) -> str:
    parts = []
    if errors.has_fast:
        parts.append(f"along max {errors.fast_max:6.3f} rms {errors.fast_rms:6.3f}")
    if math.isfinite(errors.apart_max):
        parts.append(f"forward to backward {errors.apart_max:6.3f}")
    if errors.has_slow:
        parts.append(f"across max {errors.slow_max:6.3f} rms {errors.slow_rms:6.3f}")
    return f"{label:20} {', '.join(parts)} pixels"


def _frame_document(done: FrameReport) -> dict[str, object]:
    return {
        "frame": done.label,
        "measured_px": done.measured._asdict(),
        "true_px": done.true._asdict(),
    }


def _document(result: ScanResult) -> dict[str, object]:
    return {
        "file": str(result.file),
        "axes": list(result.plan.axes),
        "sweeps": result.plan.sweeps,
        "pixels": result.plan.pixels,
        "duration_s": result.plan.duration_s,
        "frames": [_frame_document(each) for each in result.frames],
        "pulses": None if result.pulses is None else dict(result.pulses),
    }
