"""The rig of a soak: it outlives the daemon, and checks every voltage that it gets."""

from collections.abc import Sequence
from math import inf, isfinite

from piezod.config.daemon import DaemonConfig
from piezod.devices.interface import Capabilities, Identity, Sample
from piezod.devices.wiring import construct, pairs_of
from piezod.testing.faulty import FaultyDevice
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig

MOST_VIOLATIONS = 100
ROUNDING_V = 1e-6
READ_BACK_SHARE = 0.01
"""The read-back voltage, where a takeover begins, may differ by this share of the range."""


class LastingRig:
    """A simulated rig that stays as it is from one daemon to the next.

    Args:
        inner: The rig, not open.
    """

    def __init__(self, inner: SimulatedRig) -> None:
        self._inner = inner
        self._identity: Identity | None = None

    def open(self) -> Identity:
        """Open the rig at the first call."""
        if self._identity is None:
            self._identity = self._inner.open()
            self._able = self._inner.capabilities()
        else:
            self._able = self._able._replace(opens_relaxed=False)
        return self._identity

    def capabilities(self) -> Capabilities:
        """Return its capabilities; it is relaxed for its first daemon only."""
        return self._able

    def activate(self, now_ns: int) -> None:
        """Activate the rig."""
        self._inner.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring its output to rest."""
        self._inner.deactivate(now_ns)

    def close(self) -> None:
        """Leave it as it is."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample."""
        return self._inner.read(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage."""
        return self._inner.write(drive_v, now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Measure the output."""
        return self._inner.read_back(now_ns)


class CheckedRig(FaultyDevice):
    """Checks what is written, before faults change it.

    Args:
        config: The configuration of the stage, with one axis.
    """

    def __init__(self, config: DaemonConfig, seed: int) -> None:
        (made,) = construct(config.devices, pairs_of(config.axes), config.seed).values()
        assert isinstance(made, SimulatedRig)
        super().__init__(LastingRig(made), seed=seed)
        (axis,) = config.axes.values()
        self._limits, self._gap_ns = axis.limits, round(2 * NS_PER_S / config.rate_hz)
        self._range_v = self._limits.drive_max_v - self._limits.drive_min_v
        self._last_v, self._t_ns = 0.0, -self._gap_ns
        self.writes = self.refused = 0
        self.closest_v = inf
        """Smallest distance of a step from the largest allowed one, in V."""
        self.violations: list[str] = []
        self.read_back_error_v = 0.0
        """Largest error of the read-back voltage by the present faults, in V."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Check a voltage, and command it."""
        self._check(drive_v[0], now_ns)
        accepted = super().write(drive_v, now_ns)
        if accepted:
            self._last_v, self._t_ns = drive_v[0], now_ns
        self.writes += 1
        self.refused += not accepted
        return accepted

    def end_faults(self, now_ns: int) -> None:
        """Forget the faults that are over."""
        self.schedule[:] = [each for each in self.schedule if each.end_ns > now_ns]
        self.read_back_error_v *= bool(self.schedule)

    def _check(self, drive_v: float, now_ns: int) -> None:
        gap_ns = now_ns - self._t_ns
        reach_v = self._limits.slew_v_per_s * gap_ns / NS_PER_S + ROUNDING_V
        if gap_ns > self._gap_ns:
            reach_v += READ_BACK_SHARE * self._range_v + self.read_back_error_v
        left_v = reach_v - abs(drive_v - self._last_v)
        self.closest_v = min(self.closest_v, left_v)
        inside = self._limits.drive_min_v <= drive_v <= self._limits.drive_max_v
        broken = not (isfinite(drive_v) and inside and left_v >= 0.0)
        if broken and len(self.violations) < MOST_VIOLATIONS:
            self.violations.append(
                f"at {now_ns / NS_PER_S:.3f} s: {drive_v} V after {self._last_v} V, "
                f"{gap_ns / NS_PER_S:g} s before; allowed: a step of {reach_v:g} V in "
                f"{self._limits.drive_min_v:g} to {self._limits.drive_max_v:g} V"
            )
