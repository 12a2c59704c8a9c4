"""Advantech ADAM-6024 (Modbus TCP) and ADAM-4024 (Modbus RTU).

Addresses are from the tables in Advantech's public manuals of the ADAM-4000 and ADAM-6000 series.
Not confirmed on hardware.

An output of an ADAM-4024 has one of three types (ADAM-4000 manual, p. 6-20): -10 to 10 V, 0 to
20 mA, 4 to 20 mA. There is no type 0 to 10 V: code 0 means -10 V. That the codes rise evenly from 0
at -10 V to 4095 at 10 V, as the codes of the other modules do, is not confirmed.
"""

from typing import Final

from piezod_drivers.modbus.profiles.profile import (
    Constant,
    IdentityField,
    ModbusProfile,
    register_row,
)

CODES_12_BIT: Final = 0xFFF
TYPE_CODES: Final = 200
"""Type of output 0; the other outputs follow."""
TYPE_10_V: Final = 0x32
"""-10 to 10 V; 0x30 and 0x31 are currents."""
MODULE_NAME: Final = 210
VERSION: Final = 212
COMM_SAFETY: Final = 215
"""1 if the communication watchdog has set the outputs to their safe values."""

ADAM_6024: Final = ModbusProfile(
    name="adam-6024",
    maker="Advantech",
    model="ADAM-6024",
    registers=(
        *register_row(
            [f"AI{i}" for i in range(6)],
            0,
            role="input",
            scale=20 / 65_535,
            offset=-10.0,
            range=(-9.999, 9.999),
        ),
        *register_row(
            ["AO0", "AO1"], 10, role="output", scale=10 / CODES_12_BIT, range=(0.0, 10.0)
        ),
        *register_row(["AO0", "AO1"], 10, role="read-back", scale=10 / CODES_12_BIT),
        # One status word for each input: bit 1 is above its range, bit 2 below it.
        *register_row(
            [f"AI{i}" for i in range(6)], 20, role="status", flag="saturated", mask=0b110
        ),
    ),
    max_rate_hz=100.0,  # not documented; the converters are slower, the network is faster
)

ADAM_4024: Final = ModbusProfile(
    name="adam-4024",
    maker="Advantech",
    model="ADAM-4024",
    registers=(
        *register_row(
            [f"AO{i}" for i in range(4)],
            0,
            role="output",
            scale=20 / CODES_12_BIT,
            offset=-10.0,
            range=(-10.0, 10.0),
        ),
        *register_row(
            [f"AO{i}" for i in range(4)],
            0,
            role="read-back",
            scale=20 / CODES_12_BIT,
            offset=-10.0,
        ),
        *register_row([None], COMM_SAFETY, role="status", flag="watchdog tripped", mask=1),
    ),
    constants=(
        Constant("holding", MODULE_NAME, "uint16", 0x4024),
        *(
            Constant(
                "holding",
                TYPE_CODES + i,
                "uint16",
                TYPE_10_V,
                channel=f"AO{i}",
                remedy=f"set output {i} to -10 to 10 V, type 0x32, with the maker's program",
            )
            for i in range(4)
        ),
    ),
    identity_fields=(
        (
            "model",
            IdentityField(
                "holding", MODULE_NAME, "uint16", lambda number: f"ADAM-{int(number):04X}"
            ),
        ),
        (
            "firmware",
            IdentityField("holding", VERSION, "uint16", lambda number: f"{int(number):04X}"),
        ),
    ),
    max_rate_hz=100.0,  # not documented; at 38400 bit/s the line is slower
)

ADVANTECH: Final = (ADAM_6024, ADAM_4024)
