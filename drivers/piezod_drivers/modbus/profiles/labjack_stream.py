"""The stream of LabJack T4, T7 and T8: registers, limits, and the scale of its samples.

Registers, error codes and statuses are from LabJack's public register list (ljm_constants). The
packets, the addresses in flash memory and the scale of a T4 and a T7 are also in the public crate
async_labjack and in LabJack's C example for streams over TCP. Not confirmed: that a T8 scales as a
T7 does, and the time that a device needs for each address. Not confirmed on hardware.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

PORT_DISTANCE: Final = 200
"""Requests go to port 502, the stream comes from port 702."""

SCAN_RATE_HZ: Final = 4002
N_ADDRESSES: Final = 4004
SAMPLES_PER_PACKET: Final = 4006
SETTLING_US: Final = 4008
RESOLUTION_INDEX: Final = 4010
BUFFER_BYTES: Final = 4012
CLOCK_SOURCE: Final = 4014
AUTO_TARGET: Final = 4016
DATA_TYPE: Final = 4018
N_SCANS: Final = 4020
TRIGGER_INDEX: Final = 4024
SCAN_LIST: Final = 4100
ENABLE: Final = 4990
OUT_TARGET: Final = 4040
OUT_BYTES: Final = 4050
OUT_LOOP_VALUES: Final = 4060
OUT_SET_LOOP: Final = 4070
OUT_FREE_BYTES: Final = 4080
OUT_ENABLE: Final = 4090
OUT_VALUES: Final = 4400
OUT_WORDS: Final = 4420
"""As `OUT_VALUES`, for values of 16 bits."""
DIO_STATE, DIO_DIRECTION = 2500, 2600
"""The lines FIO0 to FIO7: a bit for each; the bits of the high byte leave lines alone."""
OUT_STEP: Final = 2
"""Distance of the registers of two stream-outs, except those of the scan list."""
OUT_IN_SCAN: Final = 4800
N_OUTS: Final = 4
SELF_INDEX: Final = 4898
"""A channel whose samples are its own index in the scan list."""
AIN_RANGE: Final = 40_000
LAST_ERROR: Final = 55_000
FLASH_POINTER: Final = 61_810
FLASH_READ: Final = 61_812

ETHERNET: Final = 1
"""Value of `AUTO_TARGET`: packets are sent at port 702."""
OUT_MOST_BYTES: Final = 16_384
OUT_LEAST_BYTES: Final = 32
MOST_SAMPLES: Final = 512
"""Number of samples in the longest packet over TCP."""
MOST_ADDRESSES: Final = 128
TICK_NS: Final = 100
LONGEST_TICKS: Final = 65_536
"""Above 152.588 scans/s the interval is a multiple of 100 ns; slower scans have longer steps."""
LOST: Final = 0xFFFF
"""Each sample of a scan that stands for lost ones."""

RECOVERING, RECOVERED, OVERLAP, SKIPPED_TOO_MANY, COMPLETE, FULL = (
    2940,
    2941,
    2942,
    2943,
    2944,
    2945,
)
"""Statuses of a packet; with `RECOVERED` comes the number of lost scans."""
NOT_RUNNING: Final = 2620
IS_ACTIVE: Final = 2605
ERRORS: Final[Mapping[int, str]] = {
    2600: "the scan list is empty",
    2605: "a stream is running",
    2606: "the resolution is not possible in a stream",
    2607: "a channel cannot be in a scan list",
    2608: "the rate times the number of channels is too high",
    2609: "the buffer of a stream-out is too large",
    2612: "no target for the samples is set",
    2613: "the buffer of a stream-out is full",
    2614: "the target of a stream-out is not possible",
    2615: "the size of a buffer is not possible",
    2617: "the buffer of a stream-out has no size",
    2618: "too many samples in a packet",
    2620: "no stream is running",
    2621: "the settling time is too long",
    2622: "the loop of a stream-out is longer than its buffer",
    2625: "a channel cannot be streamed",
    2627: "a stream-out must be enabled before it takes values",
}
"""What the device's own error codes mean."""


class InputScale(NamedTuple):
    """Scale of an input: volts = offset + slope · (code - center)."""

    center: float  #: Code at which the slope changes.
    above: float  #: Slope for codes from there on, in V.
    below: float  #: Slope for lower codes, in V.
    offset: float = 0.0  #: Voltage at this code, in V.


class ScaleSource(NamedTuple):
    """Place of the scale of an input in flash memory."""

    address: int  #: Address of the first byte.
    n_floats: int  #: Number of FLOAT32 values there.


class StreamPlan(NamedTuple):
    """Properties of the stream of a device."""

    shortest_ns: int  #: Shortest interval between two scans, in ns.
    address_ns: int  #: Time that each address of the scan list needs, in ns.
    n_steps: int  #: Number of steps of an output over its range.
    flash: int  #: Address of the constants in flash memory.
    #: Index of the constants for the value of an input's range register, in V; 0 is the default.
    ranges: Mapping[float, int]
    sets_of_input: int  #: Number of sets of constants for each input; 0 if all inputs share them.
    set_floats: int  #: Number of floats in each set.
    n_high: int  #: Number of inputs with constants of their own; later inputs share one set.
    has_trigger: bool = (
        True  #: Whether a stream can wait for a trigger or follow an external clock.
    )
    pulse_lines: int = 8  #: Digital outputs FIO0, FIO1, … that a stream-out can set.

    def scale_source(self, channel: int, range_v: float) -> ScaleSource | None:
        """Return the place of an input's scale; None if the range is unknown."""
        # A range is stored as FLOAT32, so 0.1 is not exactly 0.1.
        index = next((i for v, i in self.ranges.items() if abs(v - range_v) <= 1e-6 * v), None)
        if index is None:
            return None
        number = index + self.sets_of_input * min(channel, self.n_high)
        return ScaleSource(self.flash + 4 * self.set_floats * number, self.set_floats)


def input_scale(values: Sequence[float]) -> InputScale:
    """Return the scale from its constants in flash memory.

    Args:
        values: Slope and offset of a T4; slope above, slope below, center and offset of the others.
            The offset of these belongs to another formula and is not used.
    """
    if len(values) == 2:
        return InputScale(0.0, values[0], values[0], values[1])
    above, below, center = values[:3]
    # The slope below the center is negative: volts = (center - code) · slope.
    return InputScale(center, above, -below)


_T4: Final = StreamPlan(
    20_000,
    20_000,
    (1 << 10) - 1,
    0x3C4000,
    {0.0: 0, 10.0: 0, 2.5: 0},
    1,
    2,
    4,
    has_trigger=False,
    pulse_lines=0,  # FIO0 to FIO3 are analogue there
)
_T7: Final = StreamPlan(
    10_000,
    10_000,
    (1 << 12) - 1,
    0x3C4000,
    {0.0: 0, 10.0: 0, 1.0: 1, 0.1: 2, 0.01: 3},
    0,
    4,
    14,
)
_T8_RANGES_V: Final = (11.0, 9.6, 4.8, 2.4, 1.2, 0.6, 0.3, 0.15, 0.075, 0.036, 0.018)
_T8: Final = StreamPlan(
    25_000,
    10_000,
    (1 << 16) - 1,
    0x687000 + 64,
    {0.0: 0} | {range_v: i for i, range_v in enumerate(_T8_RANGES_V)},
    len(_T8_RANGES_V),
    4,
    8,
)
STREAM_PLANS: Final[Mapping[str, StreamPlan]] = {
    "labjack-t4": _T4,
    "labjack-t7": _T7,
    "labjack-t8": _T8,
}
