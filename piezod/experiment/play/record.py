"""The periods of a record that count, and reasons to refuse a record."""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from piezod.devices.played_axis import AxisPlayRecord, AxisTable
from piezod.dynamics.model import ComplexArray
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray

CLIPPED_SHARE = 0.04
"""Share of samples at the extreme value that a clipped record has; a sine on a converter of 12 bits
has 1 %."""
STUCK_SHARE = 0.2
"""A sensor is stuck if it swings less than this share of the command."""
NOISE_SHARE = 0.05
"""Largest rms noise of a sample, as a share of the swing."""
MOST_DRIFT = 0.05
"""Largest phase between the first and the last third of a record, in rad: a clock that differs by
0.1 % turns the phase by this angle in 8 periods."""
MOST_LAG = np.pi / 4
"""Largest phase between the record and the expected one, in rad."""


class Flaw(StrEnum):
    """Flaws of a record."""

    SHORT = "short"
    LOST = "lost samples"
    CLIPPED = "clipped"
    STUCK = "stuck"
    NOISY = "noisy"
    OUT_OF_STEP = "out of step"


class BadRecordError(DataError):
    """Raised for a record from which nothing may be learned."""

    def __init__(self, flaw: Flaw, what: str) -> None:
        super().__init__(f"the record is refused, {flaw.value}: {what}")
        self.flaw = flaw


class CountedPeriods(NamedTuple):
    """The last periods of a play, after the settling ones; shape (periods, n) each."""

    position_um: FloatArray  #: Measured displacement, in µm.
    true_um: FloatArray  #: True displacement, in µm; NaN if it is not known.


def counted_periods(record: AxisPlayRecord, table: AxisTable, counted: int) -> CountedPeriods:
    """Return the last periods of a play.

    Raises:
        BadRecordError: If a sample of them is missing or invalid, or the clocks differ.
    """
    n = table.period_v.size
    if record.interval_ns != table.interval_ns:
        raise BadRecordError(
            Flaw.OUT_OF_STEP,
            f"its samples are {record.interval_ns} ns apart, the points {table.interval_ns} ns; "
            "record with the clock of the table",
        )
    begin = table.lead_in_v.size + (table.cycles - counted) * n - record.first_point
    end = begin + counted * n
    if begin < 0 or record.position_um.size < end:
        raise BadRecordError(
            Flaw.SHORT,
            f"it has the points {record.first_point} to "
            f"{record.first_point + record.position_um.size}, needed are "
            f"{begin + record.first_point} to {end + record.first_point}; play fewer cycles, or "
            "look for lost data",
        )
    position_um = record.position_um[begin:end]
    lost = int(np.count_nonzero(~np.isfinite(position_um)))
    if lost:
        raise BadRecordError(
            Flaw.LOST,
            f"{lost} of {position_um.size} samples are missing or invalid; check the range of the "
            "sensor and the connection",
        )
    return CountedPeriods(
        position_um.reshape(counted, n), record.true_um[begin:end].reshape(counted, n)
    )


def check_periods(position_um: FloatArray, expected_um: FloatArray) -> None:
    """Refuse periods from which nothing may be learned.

    Args:
        position_um: (periods, n) measured displacement, in µm.
        expected_um: (n,) samples that the model of the stage expects, in µm.

    Raises:
        BadRecordError: If they are stuck, clipped, out of step or noisy.
    """
    expected, swing = np.fft.rfft(expected_um), float(np.ptp(expected_um))
    line = 1 + int(np.argmax(np.abs(expected[1:])))
    spectra = np.fft.rfft(position_um, axis=1)[:, line]
    moved = float(np.abs(np.mean(spectra)) / np.abs(expected[line]))
    if not moved >= STUCK_SHARE:
        raise BadRecordError(
            Flaw.STUCK,
            f"the sensor shows {100 * moved:.3g} % of the expected motion, needed are "
            f"{100 * STUCK_SHARE:g} %; check sensor and amplifier",
        )
    _check_clipping(position_um, expected_um)
    _check_phase(spectra, complex(expected[line]))
    noise = float(np.sqrt(np.mean(np.diff(position_um, axis=0) ** 2) / 2.0)) / swing
    if not noise <= NOISE_SHARE:
        raise BadRecordError(
            Flaw.NOISY,
            f"the noise is {100 * noise:.3g} % of the swing, allowed are {100 * NOISE_SHARE:g} %; "
            "check the sensor, or command a larger swing",
        )


def _check_clipping(position_um: FloatArray, expected_um: FloatArray) -> None:
    # A command may rest at its ends: such samples may be equal.
    near = 0.001 * np.ptp(expected_um)
    for side, sign in (("highest", 1.0), ("lowest", -1.0)):
        at_end = float(np.mean(sign * position_um == np.max(sign * position_um)))
        meant = float(np.mean(sign * expected_um >= np.max(sign * expected_um) - near))
        if at_end > CLIPPED_SHARE + meant:
            raise BadRecordError(
                Flaw.CLIPPED,
                f"{100 * at_end:.3g} % of the samples have the {side} value, expected are "
                f"{100 * meant:.3g} %; check the range of the sensor",
            )


def _check_phase(spectra: ComplexArray, expected: complex) -> None:
    lag = float(np.angle(np.mean(spectra) / expected))
    if not abs(lag) <= MOST_LAG:
        raise BadRecordError(
            Flaw.OUT_OF_STEP,
            f"it is {np.degrees(lag):.3g}° away from the expected phase, allowed are "
            f"{np.degrees(MOST_LAG):g}°; measure the response again",
        )
    third = max(1, len(spectra) // 3)
    drift = float(np.angle(np.mean(spectra[-third:]) / np.mean(spectra[:third])))
    if not abs(drift) <= MOST_DRIFT:
        raise BadRecordError(
            Flaw.OUT_OF_STEP,
            f"its phase drifts by {np.degrees(drift):.3g}°, allowed are "
            f"{np.degrees(MOST_DRIFT):.3g}°; record with the clock of the table",
        )
