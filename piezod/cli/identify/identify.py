"""`piezod identify`: fit the inverse model to recorded data."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from piezod.cli.identify.options import (
    AdoptOption,
    CreepOption,
    DataArgument,
    DelayOption,
    DriveOption,
    LiveOption,
    MethodOption,
    OrderOption,
    OutOption,
    SkipOption,
    TestOption,
    ThresholdsOption,
    check_out,
    check_usage,
    fit_settings,
    given_delay_s,
)
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.progress import progress_bar
from piezod.cli.stage_options import AxisOption, SocketOption, StageOption, connect

if TYPE_CHECKING:
    from piezod.experiment.fit.automatic import Wanted
    from piezod.experiment.fit.file import FileFit
    from piezod.experiment.fit.settings import FitSettings


class _FitJob(NamedTuple):
    """What the command line says about the fit."""

    test: Path | None  #: Another record, to test the model on; None for none.
    skip_s: float  #: Excluded start of each record, in s.
    delay_s: float | None  #: The delay, in s; None if it is to be estimated.
    settings: (
        "FitSettings | Wanted"  #: Settings of the fit, or those that are fixed and not chosen.
    )
    axis: str | None = None  #: Axis of a recording; None for the only one.

    def fit(self, file: Path, run_in_s: float, takes_surface: bool = True) -> "FileFit":
        """Return the fit to a data file.

        Args:
            file: The data file.
            run_in_s: Its first seconds, which are excluded.
            takes_surface: Whether a choice may take a surface.
        """
        from piezod.experiment.fit.automatic import Wanted
        from piezod.experiment.fit.file import identify_file

        settings = self.settings
        if isinstance(settings, Wanted):
            settings = replace(settings, surface=takes_surface)
        with progress_bar() as progress:
            progress("fitting the model", 0.0)
            return identify_file(
                file,
                test=self.test,
                skip_s=max(self.skip_s, run_in_s),
                delay_s=self.delay_s,
                axis=self.axis,
                settings=settings,
                progress=progress,
            )


def identify(  # noqa: PLR0913, PLR0917 - each argument is an option
    data: DataArgument = None,
    test: TestOption = None,
    skip_s: SkipOption = 0.0,
    delay_s: DelayOption = "auto",
    method: MethodOption = None,
    order: OrderOption = None,
    thresholds: ThresholdsOption = None,
    creep: CreepOption = None,
    out: OutOption = None,
    live: LiveOption = False,
    drive: DriveOption = None,
    adopt: AdoptOption = False,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Fit the inverse model to recorded data.

    DATA is a CSV file, or a recording of a stage as `piezod record get` copies it. With --live the
    data are recorded on a running stage, which is driven from rest and disarmed at
    the end.

    Prints the errors of the drive voltage that the model predicts from the position, and of the
    position that it predicts from the voltage, in % of the ranges: on the record, on contiguous
    blocks of it that the fit did not use, and on another record. The delay from drive to
    position is the one with the smallest error, unless --delay-s gives it. A record of one
    frequency determines it only to about one sample.
    """
    check_usage(data, live=live, only_live=(drive, adopt, stage, socket))
    check_out(out)
    settings = fit_settings(method, order, thresholds, creep)
    job = _FitJob(test, skip_s, given_delay_s(delay_s, settings), settings, None if live else axis)
    if data is not None:
        fitted = job.fit(data, 0.0)
        figure = _write(fitted, out, datetime.now(UTC))
        if json:
            _print_document(fitted, out, figure, {})
        else:
            _print_text(fitted, out, figure)
        return
    from piezod.cli.identify.live import adopt_model, print_adopted, record_and_fit

    with unwinding(), connect(stage, socket) as client:
        fitted, driven = record_and_fit(job.fit, drive, out, axis, client)
        now = datetime.now(UTC)
        figure = _write(fitted, out, now)
        if not json:
            _print_text(fitted, out, figure)  # before the adoption, which may be refused
        if adopt:
            adopt_model(fitted, driven, client, now)
    if json:
        _print_document(fitted, out, figure, {"axis": driven, "adopted": adopt})
    elif adopt:
        print_adopted()


def _write(fitted: "FileFit", out: Path | None, now: datetime) -> Path | None:
    """Write model and figure, if there is a path; return the path of the figure."""
    from piezod.experiment.fit.outputs import write_model

    return None if out is None else write_model(out, fitted, now)


def _print_text(fitted: "FileFit", out: Path | None, figure: Path | None) -> None:
    from piezod.cli.identify.view import print_fit
    from piezod.cli.output import new_console

    print_fit(new_console(), fitted, out, figure)


def _print_document(
    fitted: "FileFit", out: Path | None, figure: Path | None, live: dict[str, object]
) -> None:
    from piezod.cli.identify.document import as_document
    from piezod.cli.output import print_json

    print_json({**as_document(fitted, out, figure), **live})
