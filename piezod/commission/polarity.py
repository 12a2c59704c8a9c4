"""Step "polarity": direction and size of the displacement per volt, at a few volts."""

from math import hypot, sqrt
from typing import Final, NamedTuple

import numpy as np

from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace, joined
from piezod.errors import DeviceError

STEP_PART: Final = 0.02
"""Size of a step as a fraction of the drive range."""
LARGEST_STEP_V: Final = 3.0
"""Largest size of a step, in V."""
REPEATS: Final = 3
REST_S: Final = 0.3
SIGNIFICANT: Final = 6.0
"""Ratio of a displacement to its uncertainty above which it counts."""


class Polarity(NamedTuple):
    """Result of the step."""

    #: Mean displacement per volt, in µm/V; negative if it falls with rising voltage.
    um_per_v: float
    uncertainty_um_per_v: float  #: Its standard uncertainty, in µm/V.
    step_v: float  #: Size of the steps, in V.


def step_v(session: Session) -> float:
    """Return a small step, in V, towards the farther end of the range."""
    limits = session.limits
    size_v = min(STEP_PART * (limits.drive_max_v - limits.drive_min_v), LARGEST_STEP_V)
    room_up_v = limits.drive_max_v - session.drive_v
    return size_v if room_up_v > session.drive_v - limits.drive_min_v else -size_v


def find_polarity(session: Session, size_v: float, rms_um: float) -> tuple[Polarity, SessionTrace]:
    """Step up and down a few times, and compare the mean positions at rest.

    Raises:
        DeviceError: If the displacement is not significant, or the sensor gives no valid samples.
    """
    low_v = session.drive_v
    traces: list[SessionTrace] = []
    changes_um: list[float] = []
    before_um = _mean_um(session, traces)
    for i in range(2 * REPEATS):
        traces.append(session.go(low_v + size_v if i % 2 == 0 else low_v))
        now_um = _mean_um(session, traces)
        # Steps in both directions cancel a constant drift.
        changes_um.append((now_um - before_um) * (1 if i % 2 == 0 else -1))
        before_um = now_um
    moved_um = float(np.mean(changes_um))
    samples = REST_S * session.rate_hz
    scatter_um = float(np.std(changes_um)) / sqrt(len(changes_um))
    # A change is the difference of two means, hence the factor 2 in the variance of the noise.
    uncertainty_um = hypot(scatter_um, rms_um * sqrt(2.0 / samples))
    if not abs(moved_um) > SIGNIFICANT * uncertainty_um:  # `not >` also refuses NaN
        raise DeviceError(
            f"the stage does not move: {moved_um * 1e3:.1f} ± {uncertainty_um * 1e3:.1f} nm for "
            f"{size_v:+.2f} V: check that amplifier and sensor belong to this axis, the cable of "
            "the actuator, and that the stage is free"
        )
    return Polarity(moved_um / size_v, uncertainty_um / abs(size_v), size_v), joined(traces)


def _mean_um(session: Session, traces: list[SessionTrace]) -> float:
    """Return the mean position at rest, in µm."""
    trace = session.rest(REST_S)
    traces.append(trace)
    if not np.any(np.isfinite(trace.position_um)):
        raise DeviceError("the sensor gives no valid samples any more: check its cable and range")
    return float(np.nanmean(trace.position_um))
