"""What a session recorded of one axis."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from piezod.hysteresis.memory import FloatArray

LARGEST_PERIODS: Final = 1.6
"""Time between two rows, in periods, above which a cycle lies between them."""


@dataclass(frozen=True)
class SessionTrace:
    """Record of driving; arrays of one length."""

    t_s: FloatArray  #: Instants, in s from the first one.
    drive_v: FloatArray  #: Written voltage in force at the instant, in V.
    read_back_v: FloatArray  #: Read-back voltage, in V; NaN if there is none.
    position_um: FloatArray  #: Measured displacement, in µm; NaN if it is not valid.

    @property
    def valid_pct(self) -> float:
        """Share of valid samples, in %."""
        return 100.0 * float(np.mean(np.isfinite(self.position_um)))

    def has_gap(self, rate_hz: float, rows: int) -> bool:
        """Return whether a period is missing between the first rows."""
        return bool(np.any(np.diff(self.t_s[:rows]) * rate_hz > LARGEST_PERIODS))

    def after(self, t_s: float) -> "SessionTrace":
        """Return the part of the record from an instant on."""
        late = self.t_s >= t_s
        return SessionTrace(
            self.t_s[late], self.drive_v[late], self.read_back_v[late], self.position_um[late]
        )


def joined(traces: "list[SessionTrace]") -> SessionTrace:
    """Return traces one after the other, on one time axis."""
    t_s, begin_s = [], 0.0
    for trace in traces:
        t_s.append(begin_s + trace.t_s)
        # One more step, so that the next trace does not start at the last instant of this one.
        begin_s += float(trace.t_s[-1] + (trace.t_s[1] - trace.t_s[0]))
    return SessionTrace(
        np.concatenate(t_s),
        np.concatenate([trace.drive_v for trace in traces]),
        np.concatenate([trace.read_back_v for trace in traces]),
        np.concatenate([trace.position_um for trace in traces]),
    )
