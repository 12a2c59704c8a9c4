"""`piezod identify --live`: record a running stage, and adopt the model there."""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezod.cli.output import new_console
from piezod.cli.paths import check_writable
from piezod.cli.progress import progress_bar

if TYPE_CHECKING:
    from piezod.client import StageClient
    from piezod.experiment.fit.file import FileFit

_ADOPTED: Final = (
    "The stage uses this model from now on; `piezod params save` keeps it for the next start. Its "
    "hysteresis memory is unknown now: run `piezod arm` and `piezod condition` before a mode that "
    "adapts."
)


def record_and_fit(
    fit: Callable[[Path, float, bool], "FileFit"],
    drive: Path | None,
    out: Path | None,
    axis: str | None,
    client: "StageClient",
) -> tuple["FileFit", str]:
    """Drive and record a running stage, and fit the record.

    Args:
        fit: Function of a data file, of its excluded start in s, and of whether the axis takes a
            surface; returns the fit.
        drive: File with the drive; None for the default drive.
        out: Model file; the record is written beside it, or into the current folder if it is None,
            with a number if there is one of that name.
        axis: Name of the axis; None for the only one.
        client: Connection to the daemon of the stage.

    Returns:
        The fit, and the name of the axis.
    """
    from piezod.experiment.live.drive import read_drive
    from piezod.experiment.live.identify import record_live
    from piezod.records.new_name import new_file

    settings = read_drive(drive) if drive else None
    wanted = out.with_suffix(".csv") if out else Path(f"{client.place.stage}-record.csv")
    check_writable(wanted.parent)
    with new_file(wanted) as file, progress_bar() as progress:
        recorded = record_live(client, file, progress, axis=axis, settings=settings)
    fitted = fit(
        recorded.file, recorded.run_in_s, recorded.takes_surface
    )  # with a progress bar of its own
    fitted = replace(fitted, warnings=(*fitted.warnings, *recorded.warnings))
    return fitted.with_configured_mode(recorded.first_mode), recorded.axis


def adopt_model(fitted: "FileFit", axis: str, client: "StageClient", created_at: datetime) -> None:
    """Make a running stage use a model from now on.

    Args:
        fitted: The model.
        axis: Name of its axis.
        client: Connection to the daemon of the stage.
        created_at: Time at which the model was made, with a time zone.
    """
    from piezod.experiment.fit.model_io import to_model_file
    from piezod.experiment.live.identify import adopt_live

    model = to_model_file(fitted.chosen.fit, fitted.data, fitted.chosen.train, created_at)
    adopt_live(client, axis, model)


def print_adopted() -> None:
    """Print what the adoption means for the next commands."""
    new_console().print(_ADOPTED)
