"""WAGO 750 couplers with one analogue input and one analogue output module, over TCP or RTU.

The process image begins with the analogue modules: inputs are at 0x0000, outputs are written there
and read back from 0x0200. Watchdog, constants and item number are from WAGO's public manuals.
Modules of other kinds follow behind these; use a register map for them. Not confirmed on hardware.

The controllers PFC100 and PFC200 (items 750-8xxx) are refused. According to WAGO's public Modbus
server for them (pfc-howtos, kbusmodbusslave), function 23 returns the output image where a coupler
returns the inputs, a tripped watchdog reports 0, and stopping it needs two writes. With CODESYS 2
their watchdog has other registers (manual of the 750-8208, 9.5.4).
"""

from collections.abc import Sequence
from typing import Final

from piezod_drivers.modbus.profiles.profile import (
    Constant,
    IdentityField,
    ModbusProfile,
    Setting,
    WatchdogPlan,
    register_row,
)

CODES: Final = 0x7FF0
"""Code of 10 V: 12 bits, left-adjusted; the lowest three bits are not used."""
READ_BACK: Final = 0x0200
WATCHDOG_TIME: Final = 0x1000
WATCHDOG_MASK: Final = 0x1001
WATCHDOG_TRIGGER: Final = 0x1003
WATCHDOG_STATUS: Final = 0x1006
"""0 not active, 1 active, 2 tripped."""
WATCHDOG_STOP: Final = 0x1008
STOP_NUMBER: Final = 0xAA55  # written to WATCHDOG_STOP, it stops the watchdog
CONSTANTS: Final = (0x0000, 0xFFFF, 0x1234, 0xAAAA, 0x5555, 0x7FFF, 0x8000, 0x3FFF, 0x4000)
CONSTANTS_AT: Final = 0x2000
FIRMWARE, SERIES, ITEM = 0x2010, 0x2011, 0x2012
SERIES_NUMBER: Final = 750
ITEMS: Final = (300, 899)
"""Couplers 750-3xx and controllers 750-8xx, which have the same registers."""
_NO_PFC: Final = "a PFC100 or PFC200 (750-8xxx) does not behave like a coupler and is not supported"


def _settings(timeout_s: float, _safe_v: float) -> Sequence[Setting]:
    return [
        Setting(WATCHDOG_TIME, "uint16", round(timeout_s * 10)),
        Setting(WATCHDOG_MASK, "uint16", 0xFFFF),
    ]


def _objection(timeout_s: float, safe_v: float) -> str:
    if abs(10 * timeout_s - round(10 * timeout_s)) > 1e-6:
        return f"timeout_s must be tenths of a second (got {timeout_s:g}), allowed: 0.1, 0.2 … s"
    return "" if safe_v == 0 else f"safe must be 0, the only value it supports (got {safe_v:g} V)"


_NAMES: Final = [f"AO{i}" for i in range(4)]

WAGO: Final = (
    ModbusProfile(
        name="wago-750",
        maker="WAGO",
        model="750",
        registers=(
            *register_row(
                [f"AI{i}" for i in range(4)],
                0,
                role="input",
                table="input",
                type="int16",
                scale=10 / CODES,
                range=(-9.999, 9.999),
            ),
            *register_row(
                _NAMES, 0, role="output", type="int16", scale=10 / CODES, range=(0.0, 10.0)
            ),
            *register_row(_NAMES, READ_BACK, role="read-back", type="int16", scale=10 / CODES),
            *register_row([None], WATCHDOG_STATUS, role="status", flag="watchdog tripped", mask=2),
        ),
        write_functions=(6, 16, 23),
        constants=(
            *(
                Constant("holding", CONSTANTS_AT + i, "uint16", number)
                for i, number in enumerate(CONSTANTS)
            ),
            Constant("holding", SERIES, "uint16", SERIES_NUMBER, remedy=_NO_PFC),
            Constant("holding", ITEM, "uint16", ITEMS[0], ITEMS[1], remedy=_NO_PFC),
        ),
        identity_fields=(
            (
                "model",
                IdentityField("holding", ITEM, "uint16", lambda number: f"750-{int(number)}"),
            ),
            (
                "firmware",
                IdentityField("holding", FIRMWARE, "uint16", lambda number: f"{int(number)}"),
            ),
        ),
        max_rate_hz=500.0,  # not documented
        watchdog=WatchdogPlan(
            off=[Setting(WATCHDOG_STOP, "uint16", STOP_NUMBER, is_readable=False)],
            settings=_settings,
            on=[
                Setting(WATCHDOG_TRIGGER, "uint16", 1, is_readable=False),
                Setting(WATCHDOG_STATUS, "uint16", 1, is_written=False),
            ],
            objection=_objection,
            writes=(6, 16),  # its mask covers only the functions 1 to 16
        ),
    ),
)
