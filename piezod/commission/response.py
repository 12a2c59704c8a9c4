"""Step "delay": the delay from the drive to the sample, from the phase of small sines.

Hysteresis adds the same phase at every frequency. The delay is therefore the slope of the phase
over the frequency, not the phase itself.
"""

from math import pi
from typing import Final, NamedTuple

import numpy as np

from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace, joined
from piezod.errors import DeviceError
from piezod.hysteresis.memory import FloatArray

FREQUENCIES: Final = 5
SLOWEST, FASTEST = 1 / 400, 1 / 25
"""Frequencies of the sines, as fractions of the rate."""
CYCLES, LEAST_S = 8, 0.5
SLEW_PART: Final = 0.5
"""Fraction of the slew rate that a sine may use."""
LEAST_SAMPLES: Final = 8
"""Smallest number of valid samples for the phase of a sine."""


class Response(NamedTuple):
    """Result of the step."""

    delay_s: float  #: Delay from the voltage to the sample, in s.
    uncertainty_s: float  #: Its standard uncertainty, in s.
    frequencies_hz: FloatArray  #: (n,) frequencies of the sines.
    lag_deg: FloatArray  #: (n,) phase lag of the displacement, in degrees.

    @property
    def found(self) -> bool:
        """Whether the delay is valid: noise, or a slow loop, can give a negative one."""
        return self.delay_s >= 0.0


def measure_delay(session: Session, size_v: float) -> tuple[Response, SessionTrace]:
    """Drive small sines of several frequencies, starting at the present voltage.

    Args:
        session: The axis.
        size_v: Peak-to-peak value, in V; negative for sines below the present voltage.

    Raises:
        DeviceError: If a device reports a fault, or the sensor gives too few valid samples.
    """
    begin_v = session.drive_v
    fastest_hz = SLEW_PART * session.limits.slew_v_per_s / (2 * pi * abs(size_v))
    low_hz, high_hz = SLOWEST * session.rate_hz, min(FASTEST * session.rate_hz, fastest_hz)
    # At least a decade: over a narrow band the slope of the phase would be lost in the noise.
    frequencies_hz = np.geomspace(min(low_hz, high_hz / 10), high_hz, FREQUENCIES)
    traces, lags = [], []
    for frequency_hz in frequencies_hz:
        trace = _sine(session, begin_v, size_v, float(frequency_hz))
        traces.append(trace)
        lags.append(_lag_rad(trace, float(frequency_hz)))
        traces.append(session.go(begin_v))
    lag_rad = np.unwrap(lags)
    (delay_s, at_zero), covariance = np.polyfit(2 * pi * frequencies_hz, lag_rad, 1, cov=True)
    del at_zero  # the phase due to hysteresis and creep
    found = Response(
        float(delay_s), float(np.sqrt(covariance[0, 0])), frequencies_hz, np.degrees(lag_rad)
    )
    return found, joined(traces)


def _sine(session: Session, begin_v: float, size_v: float, frequency_hz: float) -> SessionTrace:
    def wave_v(t_s: float) -> float:
        return begin_v + size_v * (1.0 - float(np.cos(2 * pi * frequency_hz * t_s))) / 2.0

    return session.drive(wave_v, max(CYCLES / frequency_hz, LEAST_S))


def _lag_rad(trace: SessionTrace, frequency_hz: float) -> float:
    """Return the phase lag of the displacement behind the drive, without the first cycle."""
    settled = trace.after(1.0 / frequency_hz)
    valid = np.isfinite(settled.position_um)
    t_s = settled.t_s[valid]
    if t_s.size < LEAST_SAMPLES:
        raise DeviceError(
            f"the sensor gave {t_s.size} valid samples during a sine of {frequency_hz:.3g} Hz: "
            "check its cable and range"
        )
    angle = 2 * pi * frequency_hz * t_s
    # Cosine and sine, plus an offset and a linear drift from creep.
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(t_s), t_s], axis=1)
    both = np.stack([settled.drive_v[valid], settled.position_um[valid]], axis=1)
    (cosine, sine, *_), *_ = np.linalg.lstsq(basis, both, rcond=None)
    drive, position = cosine - 1j * sine
    ratio = position / drive
    # A negative polarity shifts the phase by half a cycle; that is not a lag.
    return float(-np.angle(ratio if ratio.real > 0 else -ratio))
