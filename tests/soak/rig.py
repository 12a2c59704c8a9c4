"""The rig of a soak: it outlives the daemon, and checks every voltage that it gets."""

from collections.abc import Sequence
from math import inf, isfinite

from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.devices.interface import Capabilities, Identity
from piezod.devices.wiring import construct, pairs_of
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from tests.control.judged_device import MOST_VIOLATIONS, ROUNDING_V, SENSOR_LIES, JudgedDevice
from tests.soak.player import TablePlayer


class LastingRig:
    """A simulated rig that stays as it is from one daemon to the next."""

    def __init__(self, inner: SimulatedRig) -> None:
        self._inner = inner
        self._identity: Identity | None = None
        self.activate, self.deactivate = inner.activate, inner.deactivate
        self.read, self.true_position_um = inner.read, inner.true_position_um
        self.write, self.read_back = inner.write, inner.read_back

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

    def close(self) -> None:
        """Leave it as it is."""


class CheckedRig(TablePlayer, JudgedDevice):
    """Checks what is written, before faults change it, and what is on the stage."""

    def __init__(self, config: DaemonConfig, seed: int) -> None:
        (made,) = construct(config.devices, pairs_of(config.axes), config.seed).values()
        assert isinstance(made, SimulatedRig)
        (axis,) = config.axes.values()
        each = axis.limits
        limits = Limits(each.drive_min_v, each.drive_max_v, each.slew_v_per_s)
        period_ns = round(NS_PER_S / config.rate_hz)
        super().__init__(LastingRig(made), limits, period_ns, seed)
        self.safe_v, self._gap_ns = axis.safe_v, 2 * period_ns
        self._before_v, self._t_ns = 0.0, -self._gap_ns
        self.writes = self.refused = 0
        self.broken: list[str] = []
        """Writes that are not finite, out of range, or too far from the one before."""
        self.closest_v = inf
        """Smallest distance of a step from the largest allowed one, in V."""

    def activate(self, now_ns: int) -> None:
        """Activate the rig; a play that another process has left is stopped, as devices do."""
        self.output.play(())
        super().activate(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Check a voltage, and command it."""
        if self.output.plays(now_ns):
            return False
        self._check(drive_v[0], now_ns)
        accepted = super().write(drive_v, now_ns)
        if accepted:
            self._before_v, self._t_ns = drive_v[0], now_ns
        self.writes += 1
        self.refused += not accepted
        return accepted

    def end_faults(self, now_ns: int) -> None:
        """Forget the faults that are over."""
        self.schedule[:] = [each for each in self.schedule if each.end_ns > now_ns]
        output = self.output
        output.faults[:] = [each for each in output.faults if each.end_ns > now_ns]

    def ends_ns(self, *, lies: bool) -> float:
        """Return when the last fault of the output ends, and with `lies` of sensor samples too."""
        ends = [each.end_ns for each in self.output.faults]
        ends += [each.end_ns for each in self.schedule if lies and each.kind in SENSOR_LIES]
        return max(ends, default=0)

    def is_driven(self, now_ns: int) -> bool:
        """Return whether another voltage than the safe one is on the stage."""
        return abs(self.output.output_v(now_ns) - self.safe_v) > self.limits.read_back_tolerance_v

    def _check(self, drive_v: float, now_ns: int) -> None:
        """Check that a write is finite, in range, and near the one before or the output."""
        gap_ns, output_v = now_ns - self._t_ns, self.output.output_v(now_ns)
        reach_v = self.limits.slew_v_per_s * gap_ns / NS_PER_S + ROUNDING_V
        left_v = reach_v - abs(drive_v - self._before_v)
        if gap_ns <= self._gap_ns:
            self.closest_v = min(self.closest_v, left_v)
        # After a gap, or if the output has left the write before, the output is what counts.
        left = abs(self._before_v - output_v) > self.limits.read_back_tolerance_v
        near = left and abs(drive_v - output_v) <= self.bound_v
        follows = left_v >= 0.0 or near or gap_ns > self._gap_ns
        inside = self.limits.drive_min_v <= drive_v <= self.limits.drive_max_v
        broken = not (isfinite(drive_v) and inside and follows)
        if broken and len(self.broken) < MOST_VIOLATIONS:
            self.broken.append(
                f"at {now_ns / NS_PER_S:.3f} s: {drive_v} V after {self._before_v} V, "
                f"{gap_ns / NS_PER_S:g} s before; allowed: a step of {reach_v:g} V in "
                f"{self.limits.drive_min_v:g} to {self.limits.drive_max_v:g} V"
            )
