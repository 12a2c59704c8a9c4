"""Step "noise": the sensor at a constant voltage."""

from typing import Final, NamedTuple

import numpy as np

from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace
from piezod.errors import DeviceError

DURATION_S: Final = 2.0
LEAST_VALID_PCT: Final = 90.0


class Noise(NamedTuple):
    """Result of the step."""

    rms_um: float  #: Standard deviation of the samples around a straight line, in µm.
    drift_um_per_s: float  #: Slope of that line, in µm/s.
    valid_pct: float  #: Share of valid samples, in %.
    mean_um: float  #: Mean position at the initial voltage, in µm.


def measure_noise(session: Session) -> tuple[Noise, SessionTrace]:
    """Hold the voltage and record the sensor.

    Raises:
        DeviceError: If too few of its samples are valid, or all of them are equal.
    """
    trace = session.rest(DURATION_S)
    valid = np.isfinite(trace.position_um)
    if trace.valid_pct < LEAST_VALID_PCT:
        raise DeviceError(
            f"{trace.valid_pct:.0f} % of the sensor's samples are valid, needed: "
            f"{LEAST_VALID_PCT:.0f} %: check cable, light, range and calibration of the sensor"
        )
    t_s, position_um = trace.t_s[valid], trace.position_um[valid]
    # The drift is removed: it would count as noise, the more the longer the record is.
    slope, at_zero = np.polyfit(t_s, position_um, 1)
    rms_um = float(np.std(position_um - slope * t_s - at_zero))
    # Without any noise the value is not a measurement.
    if np.ptp(position_um) == 0.0:
        raise DeviceError(
            "all samples of the sensor are equal: check whether it is stuck or not read"
        )
    return Noise(rms_um, float(slope), trace.valid_pct, float(np.mean(position_um))), trace
