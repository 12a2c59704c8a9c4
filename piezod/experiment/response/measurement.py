"""From a record of drive and displacement to a measured response."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from piezod.dynamics.measured import from_periods, from_record, noise_density
from piezod.dynamics.steps import measured_steps
from piezod.errors import DataError
from piezod.experiment.response.plan import ResponsePlan
from piezod.hysteresis.memory import FloatArray
from piezod.records.response_record import AboutVoltage, without_hold

STEP_S: Final = 0.1
"""Longest time after a step, in s."""
FEWEST_SAMPLES: Final = 400
"""Smallest number of samples of a recording."""


def measured(plan: ResponsePlan, columns: Mapping[str, FloatArray]) -> AboutVoltage:
    """Return the measurement about a voltage.

    Args:
        plan: The drive.
        columns: `drive_v` and `position_um` of each cycle, evenly in time.

    Raises:
        DataError: If the record does not contain the drive.
    """
    drive_v, position_um = columns["drive_v"], columns["position_um"]
    shift = _shift(plan, drive_v)
    part = slice(shift + plan.first, shift + plan.first + plan.periods * plan.period)
    shape = (plan.periods, plan.period)
    response = from_periods(
        drive_v[part].reshape(shape),
        position_um[part].reshape(shape),
        plan.harmonics,
        plan.period / plan.rate_hz,
    )
    first, end = plan.rest
    noise = noise_density(position_um[shift + first : shift + end], plan.rate_hz)
    begin = shift + plan.first
    return AboutVoltage(
        offset_v=plan.offset_v,
        amplitude_v=plan.amplitude_v,
        response=without_hold(response, plan.rate_hz),
        noise_hz=noise[0],
        noise_um_per_rthz=noise[1],
        step=measured_steps(
            drive_v[shift + first : begin], position_um[shift + first : begin], plan.rate_hz, STEP_S
        ),
    )


def measured_in_recording(columns: Mapping[str, FloatArray], rate_hz: float) -> AboutVoltage:
    """Return the measurement in any record.

    Args:
        columns: `drive_v` and `position_um`, evenly in time.
        rate_hz: Samples per second.

    Raises:
        DataError: If the record is too short.
    """
    drive_v, position_um = columns["drive_v"], columns["position_um"]
    if drive_v.size < FEWEST_SAMPLES:
        raise DataError(
            f"the record has {drive_v.size} samples, needed are at least {FEWEST_SAMPLES}"
        )
    response = from_record(drive_v, position_um, rate_hz)
    noise_hz, density = noise_density(position_um, rate_hz)
    # What the drive does not explain.
    coherence = np.interp(noise_hz, response.frequency_hz, response.coherence)
    return AboutVoltage(
        offset_v=float(np.mean(drive_v)),
        amplitude_v=0.5 * float(np.ptp(drive_v)),
        response=without_hold(response, rate_hz),
        noise_hz=noise_hz,
        noise_um_per_rthz=density * np.sqrt(1.0 - coherence),
        step=measured_steps(drive_v, position_um, rate_hz, STEP_S),
    )


def _shift(plan: ResponsePlan, drive_v: FloatArray) -> int:
    """Return the number of the record's sample with which the drive starts."""
    planned_v = plan.sampled_v()
    if drive_v.size < 2:
        raise DataError("the recording does not contain the drive")
    # Changes and not voltages: their correlation has a sharp peak.
    changes, planned = np.diff(drive_v), np.diff(planned_v)
    size = changes.size + planned.size  # so that a negative shift comes after all positive ones
    spectrum = np.fft.rfft(changes, size) * np.fft.rfft(planned, size).conj()
    shift = int(np.argmax(np.fft.irfft(spectrum, size)))
    last = shift + plan.first + plan.periods * plan.period
    if last > drive_v.size:
        raise DataError("the recording does not contain the whole drive; measure again")
    return shift
