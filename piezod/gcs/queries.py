"""The queries of the values of axes: each reads what it needs, and has no effect."""

from collections.abc import Awaitable, Callable, Mapping
from typing import Final

from piezod.client.arrival import has_arrived
from piezod.gcs.errors import Code, GcsRefusal
from piezod.gcs.readings import Readings
from piezod.gcs.syntax import known
from piezod.messages.answers import AxisStatus

AxisValue = Callable[[Readings, str], Awaitable[str]]
"""Returns the value of an axis as text."""

_ON_TARGET, _MOVING, _SERVO = 0x8000, 0x2000, 0x1000
_UNIT, _LOWEST, _HIGHEST = 0x07000601, 0x07000000, 0x07000001


def number(value: float) -> str:
    """Return a number with steps of 1 pm, 1 µV or 1 pm/s."""
    return f"{value:.6f}"


async def _axis(readings: Readings, axis: str) -> AxisStatus:
    return (await readings.axes())[axis]


async def position(readings: Readings, axis: str) -> str:
    """Measured position, in µm; of an axis without a sensor, the command."""
    return number(_measured_um(await _axis(readings, axis)))


async def target_um(readings: Readings, axis: str) -> float:
    """Return the target of an axis, in µm: without one the command, else the measured position.

    Raises:
        ClientError: If the daemon does not answer.
        GcsRefusal: If all are unknown.
    """
    now = await _axis(readings, axis)
    commanded_um = now.command_um if now.target_um is None else now.target_um
    # A disarmed stage has no command, and a client without a reply to `MOV?` would wait for it.
    return _measured_um(now) if commanded_um is None else commanded_um


async def target(readings: Readings, axis: str) -> str:
    """Commanded target position, in µm."""
    return number(await target_um(readings, axis))


async def voltage(readings: Readings, axis: str) -> str:
    """Drive voltage, in V."""
    now = await _axis(readings, axis)
    if now.drive_v is None:
        raise GcsRefusal(Code.NO_CONNECTION, "the voltage in force is unknown")
    return number(now.drive_v)


async def on_target(readings: Readings, axis: str) -> str:
    """Whether the axis has arrived."""
    now = await _axis(readings, axis)
    return _flag(has_arrived((await readings.status()).state, now))


async def servo(readings: Readings, axis: str) -> str:
    """Whether the axis follows its command in the mode of this server."""
    now = await _axis(readings, axis)
    return _flag(readings.servo_on((await readings.status()).state, now))


async def lowest(readings: Readings, axis: str) -> str:
    """Lowest allowed position, in µm."""
    return number((await readings.limits(axis)).low_um)


async def highest(readings: Readings, axis: str) -> str:
    """Highest allowed position, in µm."""
    return number((await readings.limits(axis)).high_um)


async def name(readings: Readings, axis: str) -> str:
    """Name of the axis in the configuration."""
    return await readings.name_of(axis)


async def unit(_readings: Readings, _axis: str) -> str:
    """Unit of positions."""
    return "um"


async def yes(_readings: Readings, _axis: str) -> str:
    """Whether the axis is referenced: always."""
    return "1"


async def no(_readings: Readings, _axis: str) -> str:
    """Whether the axis has a reference sensor: never."""
    return "0"


async def is_moving(readings: Readings) -> str:
    """Return the motion status, for `#5`: a bit for each axis, as a hexadecimal number."""
    axes, state = await readings.axes(), (await readings.status()).state
    bits = (readings.moving(state, axis) << i for i, axis in enumerate(axes.values()))
    return f"{sum(bits):X}"


async def register(readings: Readings, arguments: str) -> str:
    """Return the status register 1 of an axis, for `SRG?`: servo, moving, on target."""
    words = arguments.split()
    if len(words) != 2:
        raise GcsRefusal(Code.WRONG_COUNT, "needs an axis and the register 1")
    axes, state = await readings.axes(), (await readings.status()).state
    now = axes[known(words[0], tuple(axes))]
    if words[1] != "1":
        raise GcsRefusal(Code.OUT_OF_RANGE, f"no register {words[1]}, there is 1 only")
    bits = _SERVO * readings.servo_on(state, now) + _MOVING * readings.moving(state, now)
    bits += _ON_TARGET * has_arrived(state, now)
    return f"{words[0]} 1=0x{bits:04X}"


async def parameter(readings: Readings, arguments: str) -> str:
    """Return a parameter of an axis, for `SPA?`: unit and limits; there are no others."""
    words = arguments.split()
    if len(words) != 2:
        raise GcsRefusal(Code.WRONG_COUNT, "needs an axis and the number of a parameter")
    axis = known(words[0], tuple(await readings.axes()))
    try:
        value = await _PARAMETERS[int(words[1], 0)](readings, axis)
    except (ValueError, KeyError) as error:
        why = f"no parameter {words[1]}: piezod has unit and limits of an axis only"
        raise GcsRefusal(Code.UNKNOWN_PARAMETER, why) from error
    return f"{axis} {words[1]}={value}"


def _measured_um(now: AxisStatus) -> float:
    # Programs ask for positions all the time; without a sensor the command is the best estimate.
    position_um = now.position_um if now.has_sensor else now.command_um
    if position_um is None:
        why = "the sensor has no valid sample" if now.has_sensor else "the axis has no sensor"
        raise GcsRefusal(Code.INVALID_SENSOR_SIGNAL, why)
    return position_um


def _flag(value: bool) -> str:
    return str(int(value))


_PARAMETERS: Final[Mapping[int, AxisValue]] = {_UNIT: unit, _LOWEST: lowest, _HIGHEST: highest}
AXIS_QUERIES: Final[Mapping[str, tuple[AxisValue, str]]] = {
    "POS?": (position, "position"),
    "MOV?": (target, "target position"),
    "ONT?": (on_target, "on target"),
    "SVO?": (servo, "servo on"),
    "VOL?": (voltage, "drive voltage"),
    "TMN?": (lowest, "lowest position"),
    "TMX?": (highest, "highest position"),
    "NLM?": (lowest, "lowest position"),
    "PLM?": (highest, "highest position"),
    "CST?": (name, "name of the axis"),
    "PUN?": (unit, "unit of positions"),
    "FRF?": (yes, "referenced"),
    "TRS?": (no, "has a reference sensor"),
}
"""The queries for several axes, or for all of them, and their text in the reply to `HLP?`."""
