"""LabJack T4, T7 and T8 over Modbus TCP: FLOAT32 volts, a combined function, a watchdog.

Addresses are from LabJack's public register list (ljm_constants), frames of the combined function
from LabJack's page on direct Modbus TCP and the public crate async_labjack. The 10 V range of a T8
output follows from its steps of 160 µV. Not confirmed on hardware.
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
from piezod_drivers.modbus.register import Register

PRODUCT_ID: Final = 60_000
FIRMWARE: Final = 60_004
SERIAL: Final = 60_028
TEST: Final = 55_100
TEST_NUMBER: Final = 0x00112233
COUNTER_10KHZ: Final = 61_502
"""Counts since the start; a reset sets it to 0."""
WATCHDOG_ENABLE: Final = 61_600
WATCHDOG_TIMEOUT_S: Final = 61_604
WATCHDOG_DACS: Final = ((61_640, 61_642), (61_650, 61_652))
"""For each output: address of the enable register, address of the safe value."""
WIDE_V: Final = (-11.0, 11.0)
"""Inputs report up to 10.1 V in the largest range, and -9999 without a valid reading."""
LOW_V: Final = (0.0, 2.44)
"""T4 low-voltage analog inputs, 0 to 2.5 V (T-Series datasheet); they may end a little lower."""


def _settings(timeout_s: float, safe_v: float) -> Sequence[Setting]:
    return [
        Setting(WATCHDOG_TIMEOUT_S, "uint32", timeout_s),
        *(
            setting
            for enable, value in WATCHDOG_DACS
            for setting in (Setting(enable, "uint32", 1), Setting(value, "float32", safe_v))
        ),
    ]


def _watchdog(highest_v: float) -> WatchdogPlan:
    def objection(timeout_s: float, safe_v: float) -> str:
        if timeout_s != round(timeout_s) or timeout_s < 1:
            return f"timeout_s must be whole seconds (got {timeout_s:g}), allowed: 1, 2, 3 … s"
        if not 0 <= safe_v <= highest_v:
            return f"safe is out of range (got {safe_v:g}), allowed range 0 to {highest_v:g} V"
        return ""

    return WatchdogPlan(
        off=[Setting(WATCHDOG_ENABLE, "uint32", 0)],
        settings=_settings,
        on=[Setting(WATCHDOG_ENABLE, "uint32", 1)],
        objection=objection,
        writes=(),
    )


def _inputs(first: int, end: int, range_v: tuple[float, float]) -> tuple[Register, ...]:
    return register_row(
        [f"AIN{i}" for i in range(first, end)],
        2 * first,
        step=2,
        role="input",
        type="float32",
        range=range_v,
    )


def _profile(product: int, highest_v: float, n_inputs: int, n_low_inputs: int = 0) -> ModbusProfile:
    n_high = n_inputs - n_low_inputs
    return ModbusProfile(
        name=f"labjack-t{product}",
        maker="LabJack",
        model=f"T{product}",
        registers=(
            *_inputs(0, n_high, WIDE_V),
            *_inputs(n_high, n_inputs, LOW_V),
            *register_row(
                ["DAC0", "DAC1"],
                1000,
                step=2,
                role="output",
                type="float32",
                range=(0.0, highest_v),
            ),
        ),
        write_functions=(16,),
        feedback=True,
        constants=(
            # The test register reveals a wrong order of words, the product a wrong model.
            Constant("holding", TEST, "uint32", TEST_NUMBER),
            Constant("holding", PRODUCT_ID, "float32", product),
        ),
        identity_fields=(
            (
                "model",
                IdentityField("holding", PRODUCT_ID, "float32", lambda number: f"T{number:.0f}"),
            ),
            ("serial", IdentityField("holding", SERIAL, "uint32", lambda number: f"{number:.0f}")),
            (
                "firmware",
                IdentityField("holding", FIRMWARE, "float32", lambda number: f"{number:.4f}"),
            ),
        ),
        max_rate_hz=1000.0,  # LabJack: an exchange over Ethernet takes 1.0 ms
        watchdog=_watchdog(highest_v),
    )


LABJACK: Final = (
    _profile(4, 5.0, n_inputs=12, n_low_inputs=8),
    _profile(7, 5.0, n_inputs=14),
    _profile(8, 10.0, n_inputs=8),
)
