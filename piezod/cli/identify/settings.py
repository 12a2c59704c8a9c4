"""The settings of a fit, from the options of `piezod identify`."""

import math

import typer

from piezod.cli.identify.method_choice import DEFAULT_ORDER, MethodChoice
from piezod.config.axes import STOPS_DELAY_S
from piezod.config.model_file import FILE_DELAY_S
from piezod.experiment.fit.automatic import Wanted
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.settings import FitSettings


def given_delay_s(text: str, settings: FitSettings | Wanted) -> float | None:
    """Return the delay in s; None if it is to be estimated.

    Args:
        text: Value of `--delay-s`.
        settings: Settings of the fit: the delay of a surface may be negative.

    Raises:
        typer.BadParameter: If it is neither "auto" nor a time that the model can have.
    """
    if text == "auto":
        return None
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
) -> FitSettings | Wanted:
    """Return the settings of the fit; with `auto`, those that are fixed and not chosen.

    Args:
        method: Value of `--method`; None if not given.
        order: Value of `--order`; None if not given.
        thresholds: Value of `--thresholds`; None if not given.
        creep: Value of `--creep`; None if not given.

    Raises:
        typer.BadParameter: If the method does not have one of the other options.
    """
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
        return FitSettings(method=Method.SURFACE, creep=creep)
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
