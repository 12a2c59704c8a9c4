"""Arguments and options of `piezod identify`, and their checks."""

import math
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

from piezod.cli.paths import check_writable, existing_file
from piezod.experiment.fit.method import Method, Spacing

if TYPE_CHECKING:
    from piezod.experiment.fit.automatic import Wanted
    from piezod.experiment.fit.settings import FitSettings

DEFAULT_ORDER: Final = 19


class MethodChoice(StrEnum):
    """Values of `--method`."""

    LMS = Method.LMS.value
    LEAST_SQUARES = Method.LEAST_SQUARES.value
    SURFACE = Method.SURFACE.value
    AUTO = "auto"


DataArgument: TypeAlias = Annotated[
    Path | None,
    typer.Argument(
        metavar="DATA",
        help="CSV file with the columns t_s, drive_v, position_um, evenly spaced in time, or "
        "recording of a stage (.h5); none with --live.",
        readable=False,
        callback=existing_file,
    ),
]
TestOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="OTHER",
        help="Another record of the same stage, to test the model on.",
        readable=False,
        callback=existing_file,
    ),
]
SkipOption: TypeAlias = Annotated[
    float,
    typer.Option(
        min=0,
        metavar="S",
        help="Excluded start of each record, in s. Samples in which the unknown past before the "
        "record may matter are always excluded.",
    ),
]
DelayOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="auto|S",
        help="Delay of the displacement behind the drive, in s; auto: estimated. 0 to 1; with "
        "--method surface also negative, from -0.1, if samples were reported early.",
    ),
]
MethodOption: TypeAlias = Annotated[
    MethodChoice | None,
    typer.Option(
        help="Method of the fit: lms is the paper's; least-squares fits all its weights at once; "
        "surface fits a smooth surface of loops, for records with loops of all sizes; auto chooses "
        "the model that predicts held-out positions and voltages best. Default: auto; with "
        "--order or --thresholds, least-squares.",
        show_default=False,
    ),
]
OrderOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=200,
        metavar="M",
        help=f"Number of operators on each side; not with surface. Default: {DEFAULT_ORDER}; with "
        "auto, chosen.",
    ),
]
ThresholdsOption: TypeAlias = Annotated[
    Spacing | None,
    typer.Option(
        help="Spacing of their thresholds: even; graded, denser at both ends; placed, denser where "
        "the data bend most; not with surface. Default: graded; with lms, even; with auto, chosen.",
        show_default=False,
    ),
]
CreepOption: TypeAlias = Annotated[
    bool | None,
    typer.Option(
        "--creep/--no-creep",
        help="Whether creep is fitted too; not with lms. Default: no; with surface, yes; with "
        "auto, chosen.",
        show_default=False,
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="MODEL.yaml",
        readable=False,
        help="Write the model to this file, for `model:` of an axis, and beside it a figure of "
        "data and model (.png). Default: nothing is written.",
    ),
]
LiveOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Drive a running stage from rest and fit its record, which is stored beside the model "
        "or in the current folder, with a number if there is one of that name.",
    ),
]
DriveOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.yaml",
        readable=False,
        callback=existing_file,
        help="With --live: file with an `identification:`, which gives the drive. Default: a drive "
        "of 80 s over all voltages of the axis, which covers everything that the fit needs.",
    ),
]
AdoptOption: TypeAlias = Annotated[
    bool, typer.Option("--adopt", help="With --live: the stage uses the model from now on.")
]


def check_usage(data: Path | None, *, live: bool, only_live: Iterable[object]) -> None:
    """Refuse arguments that exclude each other.

    Args:
        data: The data file; None if none was given.
        live: Whether a running stage is driven.
        only_live: Values of the options that need `--live`; false if not given.

    Raises:
        typer.BadParameter: If arguments exclude each other, or one is missing.
    """
    if live and data is not None:
        raise typer.BadParameter("DATA and --live exclude each other")
    if not live and data is None:
        raise typer.BadParameter("Missing argument 'DATA'; or --live, for a running stage")
    if not live and any(only_live):
        message = "--drive, --adopt, --stage and --socket need --live"
        raise typer.BadParameter(message)


def check_out(out: Path | None) -> None:
    """Refuse a model file that cannot be written, before the fit.

    Args:
        out: Path of the model file; None for none.

    Raises:
        typer.BadParameter: If its suffix is not that of a YAML file.
        OSError: If its folder is not writable.
    """
    if out is None:
        return
    if out.suffix not in (".yaml", ".yml"):
        raise typer.BadParameter(f"must end in .yaml (got {out})", param_hint="'--out'")
    if out.parent.is_dir():
        check_writable(out.parent)


def given_delay_s(text: str, settings: "FitSettings | Wanted") -> float | None:
    """Return the delay in s; None if it is to be estimated.

    Args:
        text: Value of `--delay-s`.
        settings: Settings of the fit: the delay of a surface may be negative.

    Raises:
        typer.BadParameter: If it is neither "auto" nor a time that the model can have.
    """
    if text == "auto":
        return None
    from piezod.config.axes import STOPS_DELAY_S
    from piezod.config.model_file import FILE_DELAY_S
    from piezod.experiment.fit.settings import FitSettings

    surface = isinstance(settings, FitSettings) and settings.method is Method.SURFACE
    allowed = FILE_DELAY_S if surface else STOPS_DELAY_S
    try:
        delay_s = float(text)
    except ValueError:
        delay_s = math.nan
    if not allowed.low <= delay_s <= allowed.high:
        message = f"must be auto, or a time from {allowed.low:g} to {allowed.high:g} s (got {text})"
        if delay_s < 0.0 and not surface:
            message += (
                "; stop operators have no negative delay, and --method auto tries them: give "
                f"--method surface, which takes {FILE_DELAY_S.low:g} s or more"
            )
        raise typer.BadParameter(message, param_hint="'--delay-s'")
    return delay_s


def fit_settings(
    method: MethodChoice | None, order: int | None, thresholds: Spacing | None, creep: bool | None
) -> "FitSettings | Wanted":
    """Return the settings of the fit; with `auto`, those that are fixed and not chosen.

    Args:
        method: Value of `--method`; None if not given.
        order: Value of `--order`; None if not given.
        thresholds: Value of `--thresholds`; None if not given.
        creep: Value of `--creep`; None if not given.

    Raises:
        typer.BadParameter: If the method does not have one of the other options.
    """
    from piezod.experiment.fit.automatic import Wanted
    from piezod.experiment.fit.settings import FitSettings

    if method is None:
        operators_given = order is not None or thresholds is not None
        method = MethodChoice.LEAST_SQUARES if operators_given else MethodChoice.AUTO
    if method is MethodChoice.AUTO:
        return Wanted(order=order, spacing=thresholds, creep=creep)
    if method is MethodChoice.SURFACE:
        for name, value in (("--order", order), ("--thresholds", thresholds)):
            if value is not None:
                message = "a surface has no operators; leave the option out"
                raise typer.BadParameter(message, param_hint=f"'{name}'")
        return FitSettings(method=Method.SURFACE, creep=creep is not False)
    if method is MethodChoice.LMS and creep:
        message = "creep is fitted by least-squares and surface, not by lms"
        raise typer.BadParameter(message, param_hint="'--creep'")
    usual = Spacing.EVEN if method is MethodChoice.LMS else Spacing.GRADED
    return FitSettings(
        method=Method(method.value),
        order=order or DEFAULT_ORDER,
        spacing=thresholds or usual,
        creep=bool(creep),
    )
