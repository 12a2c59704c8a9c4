"""The work of `piezod identify`."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from piezod.cli.identify.document import as_document
from piezod.cli.identify.view import print_fit
from piezod.cli.output import new_console, print_json
from piezod.cli.paths import check_writable
from piezod.cli.progress import progress_bar
from piezod.client import StageClient
from piezod.experiment.fit.automatic import Wanted
from piezod.experiment.fit.file import FileFit, identify_file
from piezod.experiment.fit.model_io import to_model_file
from piezod.experiment.fit.outputs import write_model
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.live.drive import read_drive
from piezod.experiment.live.identify import adopt_live, record_live
from piezod.reading.choices import Choices
from piezod.records.new_name import new_file

_ADOPTED: Final = (
    "The stage uses this model from now on; `piezod params save` keeps it for the next start. Its "
    "hysteresis memory is unknown now: run `piezod arm` and `piezod condition` before a mode that "
    "adapts."
)


class FitJob(NamedTuple):
    """What the command line says about the fit."""

    test: Path | None  #: Another record, to test the model on; None for none.
    skip_s: float  #: Excluded start of each record, in s.
    delay_s: float | None  #: The delay, in s; None if it is to be estimated.
    settings: FitSettings | Wanted  #: Settings of the fit, or those that are fixed and not chosen.
    axis: str | None = None  #: Axis of a recording; None for the only one.
    choices: Choices = Choices()  #: What it says about the columns of the files.
    vector: bool = False  #: Whether the figure is written as SVG and PDF, too.
    verbose: bool = False  #: Whether the details are printed, too.

    def fit(self, file: Path, run_in_s: float, takes_surface: bool = True) -> FileFit:
        """Return the fit to a data file.

        Args:
            file: The data file.
            run_in_s: Its first seconds, which are excluded.
            takes_surface: Whether a choice may take a surface.
        """
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
                choices=self.choices,
                progress=progress,
            )


def fit_file(data: Path, job: FitJob, out: Path | None, *, json: bool) -> None:
    """Fit a data file, write the model if there is a path, and print it."""
    fitted = job.fit(data, 0.0)
    figure = _write(fitted, out, datetime.now(UTC), job)
    if json:
        print_json(as_document(fitted, out, figure))
    else:
        print_fit(new_console(), fitted, out, figure, verbose=job.verbose)


def fit_live(
    client: StageClient,
    job: FitJob,
    axis: str | None,
    drive: Path | None,
    out: Path | None,
    *,
    adopt: bool,
    json: bool,
) -> None:
    """Record a running stage, fit the record, and make the stage use the model if that is wanted.

    Args:
        client: Connection to the daemon of the stage.
        job: The fit.
        axis: Name of the axis; None for the only one.
        drive: File with the drive; None for the default drive.
        out: Model file; the record is written beside it, or into the current folder if it is None,
            with a number if there is one of that name.
        adopt: Whether the stage uses the model from now on.
        json: Whether one JSON document is printed.
    """
    fitted, driven = record_and_fit(client, job.fit, axis, drive, out)
    now = datetime.now(UTC)
    figure = _write(fitted, out, now, job)
    if not json:
        # Before the adoption, which may be refused.
        print_fit(new_console(), fitted, out, figure, verbose=job.verbose)
    if adopt:
        model = to_model_file(fitted.chosen.fit, fitted.data, fitted.chosen.train, now)
        adopt_live(client, driven, model)
    if json:
        print_json({**as_document(fitted, out, figure), "axis": driven, "adopted": adopt})
    elif adopt:
        new_console().print(_ADOPTED)


def record_and_fit(
    client: StageClient,
    fit: Callable[[Path, float, bool], FileFit],
    axis: str | None,
    drive: Path | None,
    out: Path | None,
) -> tuple[FileFit, str]:
    """Drive and record a running stage; return the fit to the record, and the name of the axis.

    Args:
        client: Connection to the daemon of the stage.
        fit: Function of a data file, of its excluded start in s, and of whether the axis takes a
            surface; returns the fit.
        axis: Name of the axis; None for the only one.
        drive: File with the drive; None for the default drive.
        out: Model file, beside which the record is written; None for the current folder.
    """
    settings = read_drive(drive) if drive else None
    wanted = out.with_suffix(".csv") if out else Path(f"{client.place.stage}-record.csv")
    check_writable(wanted.parent)
    with new_file(wanted) as file, progress_bar() as progress:
        recorded = record_live(client, file, progress, axis=axis, settings=settings)
    fitted = fit(recorded.file, recorded.run_in_s, recorded.takes_surface)
    fitted = replace(fitted, warnings=(*fitted.warnings, *recorded.warnings))
    return fitted.of_axis(recorded.config), recorded.axis


def _write(fitted: FileFit, out: Path | None, now: datetime, job: FitJob) -> Path | None:
    """Write model and figure, if there is a path; return the path of the figure."""
    return None if out is None else write_model(out, fitted, now, vector=job.vector)
