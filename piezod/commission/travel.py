"""How far the stage goes, in stages; the loop that it makes; how true the amplifier is."""

from typing import Final, NamedTuple

import numpy as np

from piezod.commission.session import Session, SessionTrace, joined
from piezod.errors import DeviceError

STAGES_PCT: Final = (10, 25, 50, 75, 100)
"""Parts of the drive's range, in %, each a step of its own."""
REST_S: Final = 0.2
LEAST_VALID_PCT: Final = 98.0


class Travel(NamedTuple):
    """What was found.

    Attributes:
        drive_low_v: Lowest voltage that was driven, in V.
        drive_high_v: Highest voltage that was driven, in V.
        travel_um: Displacement from the voltage found to the farthest one, in µm. It is negative
            too where the axis was found high up and driven down: `um_per_v` tells the polarity.
        um_per_v: Mean slope, in µm/V; negative where the position falls as the voltage rises.
        loop_pct: Greatest width of the loop, in % of the travel.
        noise_pct: Noise of the sensor, in % of the travel.
    """

    drive_low_v: float
    drive_high_v: float
    travel_um: float
    um_per_v: float
    loop_pct: float
    noise_pct: float


class TravelAmplifier(NamedTuple):
    """What reading back tells of the amplifier, by a straight line through all that was driven.

    Attributes:
        gain: Voltage read back per voltage written.
        offset_v: Voltage read back at 0 V, in V.
        worst_v: Greatest deviation from the line, in V.
    """

    gain: float
    offset_v: float
    worst_v: float


def excursion(session: Session, target_v: float) -> SessionTrace:
    """Ramp from the voltage found to another one, and back.

    Args:
        session: The axis.
        target_v: How far, in V.

    Raises:
        DeviceError: If the sensor does not follow: it is at the end of its range.
    """
    up, top = session.go(target_v), session.rest(REST_S)
    down, bottom = session.back(), session.rest(REST_S)
    trace = joined([up, top, down, bottom])
    if trace.valid_pct < LEAST_VALID_PCT:
        raise DeviceError(
            f"{trace.valid_pct:.0f} % of the samples on the way to {target_v:.1f} V are valid: "
            "the sensor is at the end of its range; align it, or lower the limits of the axis"
        )
    return trace


def farther_end_v(session: Session) -> float:
    """Return the end of the drive's range that is farther from the voltage found, in V."""
    low_v, high_v = session.limits.drive_min_v, session.limits.drive_max_v
    return high_v if high_v - session.found_v >= session.found_v - low_v else low_v


def travel_of(trace: SessionTrace, rms_um: float) -> Travel:
    """Return what the largest excursion tells of the stage.

    Args:
        trace: Of the excursion.
        rms_um: Noise of the sensor, in µm.

    Raises:
        DeviceError: If the sensor gives nothing at one of the two ends.
    """
    top = int(np.argmax(np.abs(trace.drive_v - trace.drive_v[0])))
    bottom_v, top_v = float(trace.drive_v[0]), float(trace.drive_v[top])
    ends_um = [_mean_near(trace, voltage) for voltage in (bottom_v, top_v)]
    travel_um = ends_um[1] - ends_um[0]
    return Travel(
        min(bottom_v, top_v),
        max(bottom_v, top_v),
        travel_um,
        travel_um / (top_v - bottom_v),
        100.0 * _loop_width_um(trace, top) / abs(travel_um),
        100.0 * rms_um / abs(travel_um),
    )


def amplifier_of(trace: SessionTrace) -> TravelAmplifier | None:
    """Return what reading back tells; None where it is nothing, or too little at rest."""
    still = np.abs(np.gradient(trace.drive_v)) < 1e-9
    told = np.isfinite(trace.read_back_v) & np.roll(still, 3) & still
    if np.count_nonzero(told) < 10:
        return None
    slope, at_zero = np.polyfit(trace.drive_v[told], trace.read_back_v[told], 1)
    off_v = trace.read_back_v[told] - slope * trace.drive_v[told] - at_zero
    return TravelAmplifier(float(slope), float(at_zero), float(np.max(np.abs(off_v))))


def _mean_near(trace: SessionTrace, drive_v: float) -> float:
    near = np.abs(trace.drive_v - drive_v) < 1e-6
    if not np.any(np.isfinite(trace.position_um[near])):
        raise DeviceError(
            f"the sensor gives no valid samples at {drive_v:.1f} V, the end of the way: align it, "
            "or change the limits of the axis"
        )
    return float(np.nanmean(trace.position_um[near]))


def _loop_width_um(trace: SessionTrace, top: int) -> float:
    """Return the greatest distance of the way back from the way there, at one voltage."""
    sign = np.sign(trace.drive_v[top] - trace.drive_v[0])
    valid = np.isfinite(trace.position_um)
    there, back = valid.copy(), valid.copy()
    there[top:], back[:top] = False, False
    grid_v = np.linspace(0.1, 0.9, 41) * abs(trace.drive_v[top] - trace.drive_v[0])
    way_v = sign * (trace.drive_v - trace.drive_v[0])
    up_um = np.interp(grid_v, way_v[there], trace.position_um[there])
    down_um = np.interp(grid_v, way_v[back][::-1], trace.position_um[back][::-1])
    return float(np.max(np.abs(down_um - up_um)))
