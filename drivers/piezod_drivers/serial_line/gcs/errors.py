"""The error codes of GCS controllers, as `ERR?` reports them."""

from collections.abc import Mapping
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag

_WRONG, _BUSY = DeviceFlag.WRONG_REQUEST, DeviceFlag.BUSY
_FAILED, _LOCAL = DeviceFlag.DEVICE_FAILURE, DeviceFlag.LOCAL_MODE

ERRORS: Final[Mapping[int, tuple[DeviceFlag, str]]] = {
    1: (_WRONG, "invalid syntax of a parameter"),
    2: (_WRONG, "unknown command"),
    3: (_WRONG, "command too long"),
    5: (_WRONG, "move with the servo off"),
    7: (_WRONG, "beyond the position limits"),
    8: (_WRONG, "velocity not allowed"),
    10: (_LOCAL, "stopped by another program"),
    15: (_WRONG, "no such axis"),
    17: (_WRONG, "parameter out of range"),
    23: (_WRONG, "axis not allowed for this command"),
    24: (_WRONG, "wrong number of parameters"),
    25: (_WRONG, "not a number"),
    26: (_WRONG, "parameter missing"),
    27: (_WRONG, "beyond the soft limits"),
    53: (_BUSY, "another motion is in progress"),
    54: (_WRONG, "unknown parameter"),
    60: (_WRONG, "protected by a password"),
    61: (_BUSY, "auto-zero is running"),
    63: (_BUSY, "initialisation is running"),
    64: (_WRONG, "read only"),
    66: (_WRONG, "beyond the voltage limits"),
    67: (_WRONG, "not enough memory for the wave"),
    72: (_LOCAL, "driven by an analog input"),
    73: (_LOCAL, "driven by the wave generator"),
    75: (_WRONG, "the wave generator has no wave"),
    76: (_BUSY, "buffer overrun"),
    79: (_LOCAL, "the servo was switched on by another program"),
    93: (_BUSY, "not possible while moving"),
    98: (_FAILED, "auto-zero failed"),
    99: (_FAILED, "the sensor is switched off"),
    215: (_FAILED, "no connection between the modules"),
    301: (_BUSY, "send buffer overflow"),
    302: (_WRONG, "voltage beyond the limits"),
    303: (_LOCAL, "the servo was switched on by another program"),
    304: (_BUSY, "receive buffer overflow"),
    307: (_BUSY, "the controller waited too long for a command"),
    308: (_BUSY, "the controller waited too long for another module"),
    333: (_FAILED, "internal hardware error"),
    400: (_WRONG, "no such wave, or no such wave generator"),
    401: (_WRONG, "the wave is not defined"),
    402: (_WRONG, "type of wave not supported"),
    403: (_WRONG, "the wave is too long"),
    404: (_WRONG, "wrong number of parameters of a wave"),
    405: (_WRONG, "parameter of a wave out of range"),
    406: (_WRONG, "mode of the wave generator not supported"),
    505: (_FAILED, "the sensor signal is invalid"),
    555: (_FAILED, "unknown error"),
    602: (_FAILED, "supply voltage out of range"),
    603: (DeviceFlag.OVER_TEMPERATURE, "temperature too high"),
    652: (_FAILED, "the sensor cannot be configured"),
    653: (_FAILED, "the sensor does not respond to its controller"),
    654: (_FAILED, "the power amplifier has failed"),
}
"""Flag and description of each error."""


def fault_of(code: int) -> LineFault:
    """Return the fault of an error code other than 0; an unknown code is a device failure."""
    flag, what = ERRORS.get(code, (_FAILED, "unknown to piezod"))
    return LineFault(flag, f"error {code}: {what}")
