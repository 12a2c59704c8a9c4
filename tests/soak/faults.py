"""The faults that a soak injects: of sensor, amplifier and bus, and of the output."""

from math import inf, nan
from typing import Final

from piezod.devices.status import DeviceFlag
from piezod.testing.injections import InjectionKind
from piezod.units import NS_PER_S
from tests.control.own_output import OutputKind

LASTS_S: Final = (0.05, 0.5, 3.0, 20.0)
K = InjectionKind
FAULTS: Final[tuple[tuple[InjectionKind, float, DeviceFlag], ...]] = (
    (K.STUCK, nan, DeviceFlag.OVERLOAD),
    (K.REPLACED, nan, DeviceFlag.OVERLOAD),
    (K.REPLACED, inf, DeviceFlag.OVERLOAD),
    (K.REPLACED, -500.0, DeviceFlag.OVERLOAD),
    (K.OFFSET, 3.0, DeviceFlag.OVERLOAD),
    (K.GAIN, -1.0, DeviceFlag.OVERLOAD),
    (K.NOISE, 0.5, DeviceFlag.OVERLOAD),
    (K.GARBAGE, 100.0, DeviceFlag.OVERLOAD),
    (K.DROPPED, nan, DeviceFlag.OVERLOAD),
    (K.LATE, 0.3 * NS_PER_S, DeviceFlag.OVERLOAD),
    (K.DUPLICATE, nan, DeviceFlag.OVERLOAD),
    (K.REFUSED, nan, DeviceFlag.OVERLOAD),
    (K.UNACKNOWLEDGED, nan, DeviceFlag.OVERLOAD),
    (K.LOST, nan, DeviceFlag.DISCONNECTED),
    (K.LOST, nan, DeviceFlag.BUS_OFF),
    (K.READ_RAISES, nan, DeviceFlag.OVERLOAD),
    (K.WRITE_RAISES, nan, DeviceFlag.OVERLOAD),
    *((K.SENSOR_FLAGGED, nan, flag) for flag in (DeviceFlag.LOW_LIGHT, DeviceFlag.SATURATED)),
    *(
        (K.FLAGGED, nan, flag)
        for flag in (
            DeviceFlag.OVERLOAD,
            DeviceFlag.OVER_TEMPERATURE,
            DeviceFlag.LOCAL_MODE,
            DeviceFlag.WATCHDOG_TRIPPED,
            DeviceFlag.SHORT_OR_OPEN,
            DeviceFlag.RESTARTED,
            DeviceFlag.GARBAGE,
            DeviceFlag.BAD_CHECKSUM,
            DeviceFlag.LATE_REPLY,
            DeviceFlag.SLOW_REPLY,
        )
    ),
)
OUTPUT_FAULTS: Final[tuple[tuple[OutputKind, float], ...]] = (
    (OutputKind.STUCK, nan),
    (OutputKind.SCALED, 0.6),
    (OutputKind.SCALED, 1.3),
    (OutputKind.LATE, 0.3),
    (OutputKind.LATE, 1.0),
    (OutputKind.SLOW, 0.3),
    (OutputKind.OFF, nan),
    (OutputKind.ELSEWHERE, 40.0),
    (OutputKind.ELSEWHERE, 120.0),
    (OutputKind.FROZEN_READ_BACK, nan),
    (OutputKind.FALSE_READ_BACK, 0.0),
    (OutputKind.FALSE_READ_BACK, 60.0),
    (OutputKind.FALSE_READ_BACK, 150.0),
    (OutputKind.SHIFTED_READ_BACK, 5.0),
    (OutputKind.SHIFTED_READ_BACK, 30.0),
    (OutputKind.SCALED_READ_BACK, 0.6),
    (OutputKind.SCALED_READ_BACK, 1.3),
    (OutputKind.LATE_READ_BACK, 0.3),
    (OutputKind.LATE_READ_BACK, 1.0),
)
