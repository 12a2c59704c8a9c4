"""Waveshare Modbus RTU Analog Input 8CH and Analog Output 8CH, and the (B) versions for volts.

From Waveshare's public wiki: inputs by function 4 and outputs by functions 3, 6, 16, in µA or mV;
version at 0x8000, the mode of input n at 0x0FFF + n. Inputs must be in their default mode, 0 to
20 mA or 0 to 10 V; in the others the numbers have another meaning. Not confirmed on hardware.
"""

from typing import Final, Literal

from piezod_drivers.modbus.profiles.profile import (
    Constant,
    IdentityField,
    ModbusProfile,
    register_row,
)

VERSION: Final = 0x8000
MODES: Final = 0x1000
"""Mode of input 1; the other inputs follow."""
VOLTS: Final = 0
"""0 to 5 V, or 0 to 10 V of the (B) version."""
MILLIAMPERES: Final = 2
"""0 to 20 mA."""
_IDENTITY_FIELDS: Final = (
    (
        "firmware",
        IdentityField("holding", VERSION, "uint16", lambda number: f"V{number / 100:.2f}"),
    ),
)


def _input(name: str, model: str, unit: Literal["V", "mA"], highest: float) -> ModbusProfile:
    names = [f"AI{i}" for i in range(1, 9)]
    mode = VOLTS if unit == "V" else MILLIAMPERES
    return ModbusProfile(
        name=name,
        maker="Waveshare",
        model=model,
        registers=register_row(
            names,
            0,
            role="input",
            table="input",
            scale=1e-3,
            unit=unit,
            # At the end of its range the converter is saturated.
            range=(0.0, 0.9999 * highest),
        ),
        constants=tuple(
            Constant(
                "holding",
                MODES + i,
                "uint16",
                mode,
                channel=channel,
                remedy=f"set input {i + 1} to mode {mode}, 0 to {highest:g} {unit}",
            )
            for i, channel in enumerate(names)
        ),
        identity_fields=_IDENTITY_FIELDS,
        max_rate_hz=100.0,  # not documented; at 115200 bit/s the line is slower
    )


def _output(name: str, model: str, unit: Literal["V", "mA"], highest: float) -> ModbusProfile:
    names = [f"AO{i}" for i in range(1, 9)]
    return ModbusProfile(
        name=name,
        maker="Waveshare",
        model=model,
        registers=(
            *register_row(names, 0, role="output", scale=1e-3, unit=unit, range=(0.0, highest)),
            *register_row(names, 0, role="read-back", scale=1e-3, unit=unit),
        ),
        identity_fields=_IDENTITY_FIELDS,
        max_rate_hz=100.0,  # not documented; at 115200 bit/s the line is slower
    )


WAVESHARE: Final = (
    _input("waveshare-ai8", "Modbus RTU Analog Input 8CH", "mA", 20.0),
    _input("waveshare-ai8b", "Modbus RTU Analog Input 8CH (B)", "V", 10.0),
    _output("waveshare-ao8", "Modbus RTU Analog Output 8CH", "mA", 20.0),
    _output("waveshare-ao8b", "Modbus RTU Analog Output 8CH (B)", "V", 10.0),
)
