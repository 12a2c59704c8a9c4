"""The trigger input of a simulated rig, and the camera that pulses it."""

from collections.abc import Iterator
from itertools import count
from math import inf
from typing import Annotated, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity
from piezod.devices.player import SeenEdge
from piezod.units import NS_PER_S

_LATER = 0.25
"""How long after a pulse an extra one comes, in intervals."""
_HIGH = 0.2
"""How long a pulse lasts, in intervals."""
Numbers: TypeAlias = tuple[Annotated[int, Quantity(1, 1_000_000)], ...]


class CameraOptions(ConfigModel):
    """A camera that pulses at a steady rate from the start of a play that waits for edges."""

    rate_hz: Annotated[float, Quantity(0.01, 10_000, "Hz")] = Field(
        100.0, description="pulses per second"
    )
    first_s: Annotated[float, Quantity(0, 3600, "s")] = Field(
        0.05, description="time of the first pulse after the start, s"
    )
    pulses: Annotated[int, Quantity(1, 1_000_000)] = Field(1_000_000, description="most pulses")
    missing: Numbers = Field((), description="numbers of pulses that do not come, the first is 1")
    extra: Numbers = Field((), description="numbers of pulses that another one follows too early")

    def times_ns(self) -> Iterator[int]:
        """Yield the time of each pulse from the start on, in ns."""
        interval_ns = NS_PER_S / self.rate_hz
        for k in count():
            if k >= self.pulses:
                return
            t_ns = round(self.first_s * NS_PER_S + k * interval_ns)
            if k + 1 not in self.missing:
                yield t_ns
            if k + 1 in self.extra:
                yield t_ns + round(_LATER * interval_ns)


class CameraLine:
    """The level of the camera's output, for a part of the interval high. Real-time safe.

    Args:
        camera: What pulses, from instant 0 on; None for nothing.
    """

    def __init__(self, camera: CameraOptions | None) -> None:
        self._times = iter(()) if camera is None else camera.times_ns()
        self._next_ns, self._ends_ns = next(self._times, inf), -inf
        self._high_ns = 0.0 if camera is None else _HIGH * NS_PER_S / camera.rate_hz

    def is_high(self, t_ns: int) -> bool:
        """Return whether it is high at an instant, in ns; the instants never decrease."""
        while self._next_ns <= t_ns:
            self._ends_ns = self._next_ns + self._high_ns
            self._next_ns = next(self._times, inf)
        return t_ns < self._ends_ns


class TriggerInput:
    """The edges that a play sees; times are from its start, in ns. Real-time safe.

    Args:
        camera: What pulses; None for nothing.
    """

    def __init__(self, camera: CameraOptions | None) -> None:
        self._camera = camera
        self.begin()

    def begin(self) -> None:
        """Begin a play."""
        self._times = iter(()) if self._camera is None else self._camera.times_ns()
        self._next_ns = next(self._times, inf)
        self.seen: list[SeenEdge] = []
        """The edges so far."""

    def pass_to(self, t_ns: int) -> None:
        """See the edges before an instant, for which nothing waits."""
        while self._next_ns < t_ns:
            self._see(used=False)

    def edge_by(self, t_ns: int) -> int | None:
        """Return the instant of the next edge, for which a play waits; None if it comes later."""
        return self._see(used=True) if self._next_ns <= t_ns else None

    def _see(self, *, used: bool) -> int:
        t_ns = int(self._next_ns)
        self.seen.append(SeenEdge(t_ns, used))
        self._next_ns = next(self._times, inf)
        return t_ns
