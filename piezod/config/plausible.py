"""Whether the model of a stage fits the axis that uses it, by ranges and gains.

A model of unscaled data, such as the monitor outputs of amplifier and sensor, or in another unit,
is off by a factor. The bounds are wide enough for every real stage: its gain grows with its swing,
and its load and its specimen change it.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

LEAST_COVERED: Final = 0.2
"""Smallest share of the limits that a model may cover; that of a monitor output is at most 0.1."""
BEYOND_LIMITS: Final = 0.02
"""Share of the limits by which a model may exceed them."""
WIDEST_COMMANDS: Final = 2.0
"""Widest range of commands, in travels of the model."""
NARROWEST_COMMANDS: Final = 0.005
"""Narrowest range of commands, in travels of the model: positions in nm are off by 1000."""
LARGEST_RATIO: Final = 5.0 / 3.0
"""Largest ratio of gains, or ranges, of the stage and of its data sheet, and of the inverse."""
SMALL_SWING, SMALL_RATIO = 0.3, 2.5
"""Below this share of the volts of the data sheet, gains may be smaller by this factor."""


class Span(NamedTuple):
    """What a record or a model says of a stage."""

    low_v: float  #: Lowest voltage.
    high_v: float  #: Highest voltage.
    travel_um: float  #: Difference of the positions at both.


class Sheet(NamedTuple):
    """What the data sheet of a stage says."""

    travel_um: float  #: Travel, in µm.
    volts: float  #: Range of the voltage for it, in V.


def misfits_of_model(
    model: Span,
    limits_v: tuple[float, float],
    command_um: tuple[float, float] | None,
    sheet: Sheet | None,
) -> Iterator[str]:
    """Yield why a model is not that of the axis, each with both numbers and the probable cause.

    Args:
        model: The model, or the record that it is fitted to.
        limits_v: Drive limits of the axis, in V.
        command_um: Range of the commands of the axis, in µm; None if it has none.
        sheet: Data sheet of the stage; None if it is not known.
    """
    low_v, high_v = limits_v
    width_v, holds = model.high_v - model.low_v, f"{model.low_v:.4g} to {model.high_v:.4g} V"
    slack_v = BEYOND_LIMITS * (high_v - low_v)
    if model.low_v < low_v - slack_v or model.high_v > high_v + slack_v:
        yield (
            f"holds from {holds}, beyond the limits of the axis, {low_v:g} to {high_v:g} V; is it "
            "the model of another stage?"
        )
    elif width_v < LEAST_COVERED * (high_v - low_v):
        yield (
            f"holds from {holds}, {100.0 * width_v / (high_v - low_v):.2g} % of the limits of the "
            f"axis, {low_v:g} to {high_v:g} V, allowed are {100.0 * LEAST_COVERED:g} % or more; "
            "was it fitted to a monitor output, or to kV? Then identify again with --scale "
            "drive=GAIN; else narrow the limits to what is used"
        )
    if command_um is not None:
        yield from _misfit_of_commands(model.travel_um, command_um)
    if sheet is not None and model.high_v > model.low_v:
        yield from _misfit_of_gain(model, width_v, sheet)


def misfits_of_axis(
    limits_v: tuple[float, float], command_um: tuple[float, float] | None, sheet: Sheet
) -> Iterator[str]:
    """Yield what of an axis does not fit the data sheet of its stage, each with both numbers."""
    width_v = limits_v[1] - limits_v[0]
    if width_v > LARGEST_RATIO * sheet.volts:
        yield (
            f"its {sheet.travel_um:g} µm for {sheet.volts:g} V do not fit the limits, which span "
            f"{width_v:g} V; correct one of them"
        )
    if command_um is not None and command_um[1] - command_um[0] > LARGEST_RATIO * sheet.travel_um:
        yield (
            f"its {sheet.travel_um:g} µm do not fit command_range_um, {command_um[0]:g} to "
            f"{command_um[1]:g} µm; correct one of them"
        )


def _misfit_of_commands(travel_um: float, command_um: tuple[float, float]) -> Iterator[str]:
    commanded_um = command_um[1] - command_um[0]
    both = (
        f"moves over {travel_um:.4g} µm, and command_range_um asks for {command_um[0]:g} to "
        f"{command_um[1]:g} µm"
    )
    if commanded_um > WIDEST_COMMANDS * travel_um:
        yield (
            f"{both}, {commanded_um / travel_um:.3g} times as much; were its positions in mm, or "
            "in V of a monitor output? Then identify again with --scale position=FACTOR; else "
            "correct command_range_um"
        )
    elif 0.0 < commanded_um < NARROWEST_COMMANDS * travel_um:
        yield (
            f"{both}, {100.0 * commanded_um / travel_um:.2g} % of it; were its positions in nm? "
            "Then identify again with --scale position=0.001; else correct command_range_um"
        )


def _misfit_of_gain(model: Span, width_v: float, sheet: Sheet) -> Iterator[str]:
    gain, expected = model.travel_um / width_v, sheet.travel_um / sheet.volts
    smaller = SMALL_RATIO if width_v < SMALL_SWING * sheet.volts else LARGEST_RATIO
    if not 1.0 / smaller <= gain / expected <= LARGEST_RATIO:
        yield (
            f"moves by {1e3 * gain:.4g} nm per V, and expected_travel_um and expected_volts ask "
            f"for {1e3 * expected:.4g}, {sheet.travel_um:g} µm for {sheet.volts:g} V; allowed are "
            f"{1.0 / smaller:.2g} to {LARGEST_RATIO:.3g} times that; was its drive or its position "
            "not in V and µm? Then identify again with --scale"
        )
