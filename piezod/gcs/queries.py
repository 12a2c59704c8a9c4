"""The queries of the values of axes: each reads what it needs, and has no effect."""

from collections.abc import Callable, Mapping
from typing import Final

from piezod.gcs.errors import Code, GcsRefusal
from piezod.gcs.readings import AxisNow
from piezod.gcs.syntax import known
from piezod.messages.answers import AXIS

AxisValue = Callable[[AxisNow], str]
"""Returns the value of an axis as text."""

_ON_TARGET, _MOVING, _SERVO = 0x8000, 0x2000, 0x1000
_UNIT, _LOWEST, _HIGHEST = 0x07000601, 0x07000000, 0x07000001


def number(value: float) -> str:
    """Return a number with steps of 1 pm, 1 µV or 1 pm/s."""
    return f"{value:.6f}"


def yes(_now: AxisNow) -> str:
    """Return what is true of every axis: it is online, and referenced."""
    return "1"


def is_moving(axes: Mapping[str, AxisNow]) -> str:
    """Return the motion status, for `#5`: a bit for each axis, as a hexadecimal number."""
    return f"{sum(now.moving << i for i, now in enumerate(axes.values())):X}"


def register(axes: Mapping[str, AxisNow], arguments: str) -> str:
    """Return the status register 1 of an axis, for `SRG?`: servo, moving, on target."""
    words = arguments.split()
    if len(words) != 2:
        raise GcsRefusal(Code.WRONG_COUNT, "needs an axis and the register 1")
    now = axes[known(words[0], tuple(axes))]
    if words[1] != "1":
        raise GcsRefusal(Code.OUT_OF_RANGE, f"no register {words[1]}, there is 1 only")
    bits = _SERVO * now.servo_on + _MOVING * now.moving + _ON_TARGET * now.arrived
    return f"{words[0]} 1=0x{bits:04X}"


def parameter(axes: Mapping[str, AxisNow], arguments: str) -> str:
    """Return a parameter of an axis, for `SPA?`: unit and limits; there are no others."""
    words = arguments.split()
    if len(words) != 2:
        raise GcsRefusal(Code.WRONG_COUNT, "needs an axis and the number of a parameter")
    axis = known(words[0], tuple(axes))
    try:
        value = _PARAMETERS[int(words[1], 0)](axes[axis])
    except (ValueError, KeyError) as error:
        why = f"no parameter {words[1]}: piezod has unit and limits of an axis only"
        raise GcsRefusal(Code.UNKNOWN_PARAMETER, why) from error
    return f"{axis} {words[1]}={value}"


def _unit(now: AxisNow) -> str:
    return now.facts.ascii_unit


def _lowest(now: AxisNow) -> str:
    return number(now.limits.range_um[0])


def _highest(now: AxisNow) -> str:
    return number(now.limits.range_um[1])


def _words(field: str) -> str:
    """Return what a field of an axis is, with its unit."""
    shown = AXIS[field]
    return f"{shown.shown.what}, {shown.unit.ascii}" if shown.unit.sign else shown.shown.what


_PARAMETERS: Final[Mapping[int, AxisValue]] = {_UNIT: _unit, _LOWEST: _lowest, _HIGHEST: _highest}
AXIS_QUERIES: Final[Mapping[str, tuple[AxisValue, str]]] = {
    "POS?": (lambda now: number(now.measured_um), _words("position_um")),
    "MOV?": (lambda now: number(now.target_um), _words("target_um")),
    "ONT?": (lambda now: f"{now.arrived:d}", _words("on_target")),
    "SVO?": (lambda now: f"{now.servo_on:d}", "servo on"),
    "VOL?": (lambda now: number(now.drive_v), _words("drive_v")),
    "TMN?": (_lowest, "lowest position"),
    "TMX?": (_highest, "highest position"),
    "NLM?": (_lowest, "lowest position"),
    "PLM?": (_highest, "highest position"),
    "CST?": (lambda now: now.name, "name of the axis"),
    "PUN?": (_unit, "unit of positions"),
    "FRF?": (yes, "referenced"),
    "TRS?": (lambda _now: "0", "has a reference sensor"),
}
"""The queries for several axes, or for all of them, and their text in the reply to `HLP?`."""
