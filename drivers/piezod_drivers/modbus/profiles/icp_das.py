"""ICP DAS M-7017(R) and M-7024R on RS-485 (Modbus RTU), in the format of engineering units.

Addresses are from ICP DAS' public "M-7000 Address Mapping" and quick start guides: coil 269 chooses
the format, coil 270 reports the host watchdog. The scale of 1 mV, for ±10 V and 0 to 10 V, is not
confirmed on hardware.

An M-7017C measures currents (quick start guide of I-7017(F)C and M-7017C), so it does not fit. That
the range of an M-7017 is at 40487, as in the quick start guides of tM modules, is not confirmed.
"""

from typing import Final

from piezod_drivers.modbus.profiles.profile import (
    Constant,
    IdentityField,
    ModbusProfile,
    register_row,
)

FORMAT: Final = 268
"""Coil: 0 for hexadecimal, 1 for engineering units. Counted from 0, hence 268 for coil 269."""
WATCHDOG_TRIPPED: Final = 269
"""Coil: 1 if the host watchdog has set the outputs to their safe values."""
FIRMWARE: Final = 480
TYPE_CODE: Final = 486
"""Range of all inputs."""
TYPE_10_V: Final = 0x08
"""-10 to 10 V, as in all modules of the 7000 series."""

_UNITS: Final = "set the module to the format of engineering units"
_IDENTITY_FIELDS: Final = (
    ("firmware", IdentityField("holding", FIRMWARE, "uint16", lambda number: f"{int(number):04X}")),
)

M_7017: Final = ModbusProfile(
    name="icpdas-m7017",
    maker="ICP DAS",
    model="M-7017",
    registers=register_row(
        [f"AI{i}" for i in range(8)],
        0,
        role="input",
        table="input",
        type="int16",
        scale=1e-3,
        range=(-9.999, 9.999),
    ),
    constants=(
        Constant("coil", FORMAT, "uint16", 1, remedy=_UNITS),
        Constant(
            "holding",
            TYPE_CODE,
            "uint16",
            TYPE_10_V,
            remedy="set the module to -10 to 10 V, type 0x08; an M-7017C measures currents and "
            "does not fit",
        ),
    ),
    identity_fields=_IDENTITY_FIELDS,
    max_rate_hz=10.0,  # conversions per second according to public sources; not confirmed
)

M_7024: Final = ModbusProfile(
    name="icpdas-m7024",
    maker="ICP DAS",
    model="M-7024R",
    registers=(
        *register_row(
            [f"AO{i}" for i in range(4)],
            0,
            role="output",
            type="int16",
            scale=1e-3,
            range=(0.0, 10.0),
        ),
        *register_row([f"AO{i}" for i in range(4)], 0, role="read-back", type="int16", scale=1e-3),
        *register_row(
            [None], WATCHDOG_TRIPPED, role="status", table="coil", flag="watchdog tripped"
        ),
    ),
    constants=(Constant("coil", FORMAT, "uint16", 1, remedy=_UNITS),),
    identity_fields=_IDENTITY_FIELDS,
    max_rate_hz=100.0,  # not documented; at 115200 bit/s the line is slower
)

ICP_DAS: Final = (M_7017, M_7024)
