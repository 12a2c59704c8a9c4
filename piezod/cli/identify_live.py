"""`piezod identify --live`: the record comes from a running stage, and the model may go there."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from piezod.cli.paths import check_writable

if TYPE_CHECKING:
    from piezod.client import StageClient
    from piezod.experiment.fit.file import FileFit

ADOPTED = (
    "The stage uses this model from now on; `piezod params save` keeps it for the next start. Its "
    "memory is new: `piezod arm` and `piezod condition` come before a mode that adapts."
)


def check_usage(data: Path | None, *, live: bool, only_live: Iterable[object]) -> None:
    """Refuse arguments that do not go together.

    Args:
        data: The data file, None where there is none.
        live: Whether a stage is to be driven.
        only_live: Values of the options that need one; those that were not given are false.

    Raises:
        typer.BadParameter: If they do not.
    """
    if live and data is not None:
        raise typer.BadParameter("DATA.csv and --live exclude each other")
    if not live and data is None:
        raise typer.BadParameter("Missing argument 'DATA.csv'; or --live, for a running stage")
    if not live and any(only_live):
        message = "--drive, --adopt, --axis, --stage and --socket need --live"
        raise typer.BadParameter(message)


def record_and_fit(
    fit: Callable[[Path, float], "FileFit"],
    drive: Path | None,
    out: Path | None,
    axis: str | None,
    client: "StageClient",
) -> tuple["FileFit", str]:
    """Drive and record a running stage, and fit to the record; return the fit and the axis.

    Args:
        fit: Fits to a data file of which the first seconds do not count.
        drive: File with the drive; None for the one that is designed.
        out: Model file; the record is written beside it, else into the current folder.
        axis: Name of the axis; None for the only one.
        client: A connection to the stage's daemon.
    """
    from piezod.cli.progress import progress_bar
    from piezod.experiment.live.drive import read_drive
    from piezod.experiment.live.identify import record_live

    settings = read_drive(drive) if drive else None
    file = out.with_suffix(".csv") if out else Path(f"{client.socket.parent.name}-record.csv")
    check_writable(file.parent)
    with progress_bar() as progress:
        recorded = record_live(client, file, progress, axis=axis, settings=settings)
        progress("fitting", 1.0)
        fitted = fit(file, recorded.run_in_s)
    return replace(fitted, warnings=(*fitted.warnings, *recorded.warnings)), recorded.axis


def adopt_model(fitted: "FileFit", axis: str, client: "StageClient", created_at: datetime) -> None:
    """Have a running stage use a model from now on.

    Args:
        fitted: The model.
        axis: Name of its axis.
        client: A connection to the stage's daemon.
        created_at: When the model was made, with a time zone.
    """
    from piezod.experiment.fit.model_io import to_model_file
    from piezod.experiment.live.identify import adopt_live

    model = to_model_file(fitted.taken.fit, fitted.data, fitted.taken.train, created_at)
    adopt_live(client, axis, model)
