"""Advantech ADAM-6024 (Modbus TCP) and ADAM-4024 (Modbus RTU).

Addresses after the tables in Advantech's public manuals of the ADAM-4000 and ADAM-6000 series.
Codes of the ADAM-4024 are those of its range 0 to 10 V; not confirmed on hardware.
"""

from typing import Final

from piezod_drivers.modbus.profiles.profile import Constant, Fact, ModbusProfile, row

CODES_12_BIT: Final = 0xFFF
MODULE_NAME: Final = 210
VERSION: Final = 212
COMM_SAFETY: Final = 215
"""Whether the communication watchdog has put the outputs to their safe values."""

ADAM_6024: Final = ModbusProfile(
    name="adam-6024",
    maker="Advantech",
    model="ADAM-6024",
    registers=(
        *row(
            [f"AI{i}" for i in range(6)],
            0,
            role="input",
            scale=20 / 65_535,
            offset=-10.0,
            range=(-9.999, 9.999),
        ),
        *row(["AO0", "AO1"], 10, role="output", scale=10 / CODES_12_BIT, range=(0.0, 10.0)),
        *row(["AO0", "AO1"], 10, role="read-back", scale=10 / CODES_12_BIT),
        # Of each input: bit 1 over, bit 2 under its range.
        *row([f"AI{i}" for i in range(6)], 20, role="status", flag="saturated", mask=0b110),
    ),
    max_rate_hz=100.0,  # not documented: its converters are slower, its network is not
)

ADAM_4024: Final = ModbusProfile(
    name="adam-4024",
    maker="Advantech",
    model="ADAM-4024",
    registers=(
        *row(
            [f"AO{i}" for i in range(4)],
            0,
            role="output",
            scale=10 / CODES_12_BIT,
            range=(0.0, 10.0),
        ),
        *row([f"AO{i}" for i in range(4)], 0, role="read-back", scale=10 / CODES_12_BIT),
        *row([None], COMM_SAFETY, role="status", flag="watchdog tripped", mask=1),
    ),
    constants=(Constant("holding", MODULE_NAME, "uint16", 0x4024),),
    facts=(
        ("model", Fact("holding", MODULE_NAME, "uint16", lambda number: f"ADAM-{int(number):04X}")),
        ("firmware", Fact("holding", VERSION, "uint16", lambda number: f"{int(number):04X}")),
    ),
    max_rate_hz=100.0,  # not documented; at 38400 bit/s the line is slower
)

ADVANTECH: Final = (ADAM_6024, ADAM_4024)
