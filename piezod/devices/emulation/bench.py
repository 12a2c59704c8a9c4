"""The rig behind the connectors of emulated devices: stages, amplifiers, sensors, in real time."""

from collections.abc import Callable, Sequence
from math import nan
from threading import RLock
from typing import Final, Protocol

from piezod.devices.emulation.rig_clock import RigClock
from piezod.devices.emulation.trace import Trace
from piezod.devices.interface import Amplifier, Identity, Sensor
from piezod.units import NS_PER_S

UM_PER_V: Final = 5.0
"""Scale of a conditioned sensor output: 30 µm correspond to 6 V."""
PLAYED_AT_ONCE_NS: Final = 20_000_000
"""Time of a play that is computed between two requests, at most."""
_UNNAMED: Final = Identity("piezod", "bench", "0", "0")


class Rig(Sensor, Amplifier, Protocol):
    """A combined sensor and amplifier with the inputs `a` and `a_v` for each output `a`."""


class SharedRig:
    """The connectors of a rig, shared by emulators; thread-safe.

    The physics acts at the multiples of its step, so the rig has to be activated at one of them
    (`step_ns_of`).

    A device that plays a table moves the rig at the instants of its own clock, which may be a
    little in the past. An instant before the latest one is taken as the latest one.

    Args:
        rig: The rig, open and active; its inputs are a displacement and a sensor voltage per
            output: x, x_v, y, y_v, …
        now_ns: The clock.
        trace: Records every accepted voltage; None for no record.
        identity: Identity of the rig, as returned by its `open`.
    """

    def __init__(
        self,
        rig: Rig,
        now_ns: Callable[[], int],
        trace: Trace | None = None,
        identity: Identity = _UNNAMED,
    ) -> None:
        self._rig, self.now_ns, self._trace, self.identity = rig, now_ns, trace, identity
        able = rig.capabilities()
        self.axes, self.max_rate_hz = able.outputs, able.max_rate_hz
        self.n_axes = len(self.axes)
        self._drive_v: Sequence[float] = (0.0,) * self.n_axes
        self._plays, self._step_ns = False, step_ns_of(rig)
        self._latest_ns = 0
        self._lock = RLock()

    def position_um(self, axis: int) -> float:
        """Return the measured displacement of an axis, in µm; NaN if its sensor is saturated."""
        return self.positions_um()[axis]

    def positions_um(self, at_ns: int | None = None) -> list[float]:
        """Return the measured displacement of each axis at one instant, in µm, as `position_um`.

        Args:
            at_ns: The instant; None for now.
        """
        with self._lock:
            samples = self._rig.read(self._instant_ns(at_ns))
        # Even inputs are displacements, odd ones sensor voltages.
        return [sample.position_um if sample.valid else nan for sample in samples[::2]]

    def sensor_v(self, axis: int) -> float:
        """Return the output of the fibre sensor of an axis, in V, not linearised."""
        with self._lock:
            return self._rig.read(self._instant_ns())[2 * axis + 1].position_um

    def conditioned_v(self, axis: int) -> float:
        """Return the linear output of a sensor's conditioner, in V: `UM_PER_V` µm per volt."""
        return self.position_um(axis) / UM_PER_V

    def drive(self, axis: int, drive_v: float, at_ns: int | None = None) -> bool:
        """Set the voltage at the actuator of an axis, in V; return whether that is possible.

        Args:
            axis: Index of the axis.
            drive_v: The voltage.
            at_ns: The instant; None for now.
        """
        with self._lock:
            # A rig is written as a whole; the other axes keep their last voltage.
            wanted_v = [drive_v if i == axis else v for i, v in enumerate(self._drive_v)]
            return self.drive_all(wanted_v, at_ns=at_ns)

    def drive_all(
        self, drive_v: Sequence[float], asked_ns: int = 0, pid: int = 0, at_ns: int | None = None
    ) -> bool:
        """Set the voltage at every actuator, in V; return whether that is possible.

        Args:
            drive_v: A voltage for each axis.
            asked_ns: Instant of the caller, in ns; 0 if unknown.
            pid: Process id of the caller; 0 if unknown.
            at_ns: The instant; None for now.
        """
        with self._lock:
            t_ns = self._instant_ns(at_ns)
            if not self._rig.write(drive_v, t_ns):
                return False
            self._drive_v = tuple(drive_v)
            if self._trace is not None:
                self._trace.add(t_ns, asked_ns, pid, drive_v)
            return True

    def drive_v(self, axis: int) -> float:
        """Return the measured voltage at the actuator of an axis, in V."""
        return self.drives_v()[axis]

    def drives_v(self, at_ns: int | None = None) -> Sequence[float]:
        """Return the measured voltage at the actuator of each axis at one instant, in V.

        Args:
            at_ns: The instant; None for now.
        """
        with self._lock:
            return self._rig.read_back(self._instant_ns(at_ns))

    def tick(self) -> None:
        """Advance the physics to now, so that a later request need not catch up."""
        if not self._plays:
            self.drives_v()

    def plays_from(self, next_ns: int | None) -> None:
        """Leave the time to a device that plays: `tick` does nothing, and its clock waits for it.

        Args:
            next_ns: Instant of its next point; None if it plays no more.
        """
        self._plays = next_ns is not None
        if isinstance(self.now_ns, RigClock):
            self.now_ns.wait_at(None if next_ns is None else next_ns + PLAYED_AT_ONCE_NS)

    def start_ns(self) -> int:
        """Return the instant at which a play that begins now has its first interval.

        It is an instant at which the physics acts: otherwise each play would have another delay
        between a point and its effect, up to one step.
        """
        return self.aligned_ns(self.now_ns())

    def aligned_ns(self, t_ns: int) -> int:
        """Return the first instant from `t_ns` on at which the physics acts, in ns."""
        return t_ns + -t_ns % self._step_ns

    def _instant_ns(self, at_ns: int | None = None) -> int:
        """Return an instant of the rig, which never goes back; None is now."""
        self._latest_ns = max(self.now_ns() if at_ns is None else at_ns, self._latest_ns)
        return self._latest_ns


def step_ns_of(rig: Rig) -> int:
    """Return the step of the physics of an open rig, in ns."""
    return max(round(NS_PER_S / rig.capabilities().max_rate_hz), 1)
