"""Step "travel": displacement over the drive range, width of the loop, errors of the amplifier."""

from typing import Final, NamedTuple

import numpy as np

from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace, joined
from piezod.errors import DeviceError

STAGES_PCT: Final = (10, 25, 50, 75, 100)
"""Fractions of the drive range, in %, each a separate step."""
REST_S: Final = 0.2
LEAST_VALID_PCT: Final = 98.0


class Travel(NamedTuple):
    """Result of the step."""

    drive_low_v: float  #: Lowest driven voltage, in V.
    drive_high_v: float  #: Highest driven voltage, in V.
    #: Displacement from the initial voltage to the farthest one, in µm. It is also negative if the
    #: axis was found high and driven down; `um_per_v` has the polarity.
    travel_um: float
    um_per_v: float  #: Mean slope, in µm/V; negative if the position falls with rising voltage.
    loop_pct: float  #: Largest width of the loop, in % of the travel.
    noise_pct: float  #: Noise of the sensor, in % of the travel.


class TravelAmplifier(NamedTuple):
    """Straight line of the read-back voltage over the written voltage."""

    gain: float  #: Read-back voltage per written voltage.
    offset_v: float  #: Read-back voltage at 0 V, in V.
    worst_v: float  #: Largest deviation from the line, in V.


def excursion(session: Session, target_v: float) -> SessionTrace:
    """Ramp from the initial voltage to another one and back.

    Raises:
        DeviceError: If the sensor leaves its range.
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
    """Return the end of the drive range that is farther from the initial voltage, in V."""
    low_v, high_v = session.limits.drive_min_v, session.limits.drive_max_v
    return high_v if high_v - session.found_v >= session.found_v - low_v else low_v


def travel_of(trace: SessionTrace, rms_um: float) -> Travel:
    """Return the result of the largest excursion.

    Raises:
        DeviceError: If the sensor has no valid samples at one of the two ends.
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
    """Return the line of the read-back; None without read-back, or with too few samples at rest."""
    # Only samples at rest, three cycles after the last change, so that a late read-back does not
    # count as an error.
    still = np.abs(np.gradient(trace.drive_v)) < 1e-9
    used = np.isfinite(trace.read_back_v) & np.roll(still, 3) & still
    if np.count_nonzero(used) < 10:
        return None
    slope, at_zero = np.polyfit(trace.drive_v[used], trace.read_back_v[used], 1)
    off_v = trace.read_back_v[used] - slope * trace.drive_v[used] - at_zero
    return TravelAmplifier(float(slope), float(at_zero), float(np.max(np.abs(off_v))))


def _mean_near(trace: SessionTrace, drive_v: float) -> float:
    near = np.abs(trace.drive_v - drive_v) < 1e-6
    if not np.any(np.isfinite(trace.position_um[near])):
        raise DeviceError(
            f"the sensor gives no valid samples at {drive_v:.1f} V, the end of the ramp: align it, "
            "or change the limits of the axis"
        )
    return float(np.nanmean(trace.position_um[near]))


def _loop_width_um(trace: SessionTrace, top: int) -> float:
    """Return the largest distance between the two branches at equal voltage, in µm."""
    sign = np.sign(trace.drive_v[top] - trace.drive_v[0])
    valid = np.isfinite(trace.position_um)
    there, back = valid.copy(), valid.copy()
    there[top:], back[:top] = False, False
    # Both ends are left out: there the rests with their creep lie on the branches.
    grid_v = np.linspace(0.1, 0.9, 41) * abs(trace.drive_v[top] - trace.drive_v[0])
    way_v = sign * (trace.drive_v - trace.drive_v[0])
    up_um = np.interp(grid_v, way_v[there], trace.position_um[there])
    down_um = np.interp(grid_v, way_v[back][::-1], trace.position_um[back][::-1])
    return float(np.max(np.abs(down_um - up_um)))
