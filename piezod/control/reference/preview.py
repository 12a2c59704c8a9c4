"""References that are shaped for the modes of a stage."""

from collections.abc import Callable
from math import nan

import numpy as np

from piezod.control.reference.motion import PERIOD_TOLERANCE, CornerFilter, UnknownFuture
from piezod.dynamics.model import FloatArray
from piezod.dynamics.preview import PreviewFilter
from piezod.jit import compiled


@compiled
def _shaped(ring: FloatArray, newest: int, taps: FloatArray, spacing: int) -> float:
    """Return the sum of taps times values; the ring begins after its newest value."""
    total, index = 0.0, newest + 1
    for k in range(taps.size):
        total += taps[k] * ring[index % ring.size]
        index += spacing
    return total


@compiled
def _interpolate(ring: FloatArray, first: int, points: FloatArray, spacing: int) -> None:
    """Fill a ring from an index on with straight lines between points, so many entries apart."""
    index = first
    for k in range(points.size - 1):
        slope = (points[k + 1] - points[k]) / spacing
        for j in range(spacing):
            ring[index % ring.size] = points[k] + slope * j
            index += 1
    ring[index % ring.size] = points[points.size - 1]


class PreviewedReference:
    """A reference before the modes of a stage, from its past and future values. Real-time safe.

    It keeps the values of the reference around the present one, as far as the filter reaches. In
    each cycle it evaluates the reference once, at the far end of its future. After `follow`, and
    after a skipped cycle, it evaluates the reference at the taps of the filter, and draws straight
    lines between them.
    """

    def __init__(self, preview: PreviewFilter, period_s: float) -> None:
        self._reference: Callable[[float], float] = lambda _t_s: nan
        self._taps, self._spacing = np.ascontiguousarray(preview.taps), preview.spacing
        self._period_s, self._ahead = period_s, preview.ahead
        self._ahead_s = self._ahead * period_s
        self._ring = np.zeros(2 * self._ahead + 1)
        self._points = np.zeros(preview.taps.size)
        self._newest = 0
        self._t_s, self._keeps_past = nan, False

    def follow(self, reference: Callable[[float], float], *, moving: bool) -> None:
        """Shape another reference from now on.

        Args:
            reference: Seconds since its start to µm.
            moving: Whether the stage has followed the reference before it; its values are then the
                past of the new one.
        """
        self._reference, self._t_s, self._keeps_past = reference, nan, moving

    def value(self, t_s: float) -> float:
        """Return the shaped reference, in µm.

        Args:
            t_s: Instant, in s since the start of the reference; one period more in each cycle.
        """
        step_s, self._t_s = t_s - self._t_s, t_s
        self._newest = (self._newest + 1) % self._ring.size
        if abs(step_s - self._period_s) <= PERIOD_TOLERANCE * self._period_s:
            self._ring[self._newest] = self._reference(t_s + self._ahead_s)
        else:
            self._evaluate(t_s)
        return _shaped(self._ring, self._newest, self._taps, self._spacing)

    def _evaluate(self, t_s: float) -> None:
        """Evaluate the reference at all taps, or only at those from the present on."""
        side = self._points.size // 2
        first = side if self._keeps_past else 0
        points = self._points[first:]
        for k in range(points.size):
            points[k] = self._reference(t_s + (first + k - side) * self._spacing * self._period_s)
        _interpolate(self._ring, self._newest + 1 + first * self._spacing, points, self._spacing)
        self._keeps_past = False


class ReferenceShaper:
    """Shapes references: by a preview if it can, else by rounding their corners. Real-time safe.

    Args:
        period_s: Period of the loop, in s.
        first_mode_hz: Frequency of the first mode, in Hz; None if it is unknown.
        preview: The preview filter; None if the response of the stage is unknown.
    """

    def __init__(
        self,
        period_s: float,
        first_mode_hz: float | None = None,
        preview: PreviewFilter | None = None,
    ) -> None:
        self._period_s, self._first_mode_hz = period_s, first_mode_hz
        self._previewed = None if preview is None else PreviewedReference(preview, period_s)
        self._in_use = False

    def shape(
        self, reference: Callable[[float], float], *, moving: bool
    ) -> CornerFilter | PreviewedReference:
        """Return a reference, shaped, which replaces the one before it.

        Args:
            reference: Seconds since its start to µm. The future of a stream is unknown, so that it
                has no preview.
            moving: Whether the stage has followed the reference before it.
        """
        moving = moving and self._in_use
        self._in_use = self._previewed is not None and not isinstance(reference, UnknownFuture)
        if self._previewed is None or not self._in_use:
            return CornerFilter(reference, self._first_mode_hz, self._period_s)
        self._previewed.follow(reference, moving=moving)
        return self._previewed
