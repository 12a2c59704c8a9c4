"""Watches what is learned on one axis, and the loop that is closed over it.

Detects D1, D2, D5 and D6. That weights cannot be inverted (D3) the identifiers prevent themselves;
what may not teach them (D4, D7) the gate keeps away and counts.
"""

from collections.abc import Sequence
from math import inf, isfinite
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.law.model import StageModel
from piezod.control.signals import RecentRange
from piezod.control.watch.drift import ModelDrift
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.normalisation import AffineRange
from piezod.hysteresis.online import Shadowed
from piezod.units import NS_PER_S

LEAST_AMPLITUDE: Final = 0.01
"""An error counts from this part of the range on,"""
NOISE_SIGMAS: Final = 5.0
"""and from so many standard deviations of the noise on."""
PART_NS: Final = NS_PER_S // 10
PART_CYCLES: Final = 20
"""The time is cut into parts, the longer of the two."""
PARTS, ALTERNATIONS = 5, 2
"""A stage oscillates when the error alternates so often in each of so many parts in a row: what
rings after a step has faded by then."""


class Oscillation:
    """Watches one axis; fixed memory.

    Args:
        period_ns: Period of the loop.
    """

    def __init__(self, period_ns: int) -> None:
        self._part_cycles = max(PART_NS // period_ns, PART_CYCLES)
        self._command = RecentRange(self._part_cycles)
        self._cycles = self._alternations = self._parts = 0
        self._side = 0.0
        self.amplitude, self.limit = 0.0, LEAST_AMPLITUDE
        """Largest error in the last part, and what is compared with; in units of the range."""
        self._largest = 0.0

    @property
    def found(self) -> bool:
        """Whether the stage oscillates."""
        return self._parts >= PARTS

    def forget(self) -> None:
        """Begin anew; may be called in the loop."""
        self._cycles = self._alternations = self._parts = 0
        self._side = self._largest = 0.0
        self._command.forget()

    def update(self, command: float, position: float, noise: float) -> None:
        """Take a cycle; in units of the range, finite. May be called in the loop.

        Args:
            command: Displacement asked for.
            position: Measured displacement.
            noise: Standard deviation of its noise.
        """
        error = command - position
        self._command.add(command)
        limit = max(LEAST_AMPLITUDE, NOISE_SIGMAS * noise)
        if abs(error) > limit:
            self._alternations += error * self._side < 0.0
            self._side = error
        self._largest = max(self._largest, abs(error))
        self._cycles += 1
        if self._cycles == self._part_cycles:
            alternates = self._alternations >= ALTERNATIONS and self._command.swing < limit
            self._parts = min(self._parts + 1, PARTS) if alternates else 0
            self.amplitude, self.limit = self._largest, limit
            self._cycles = self._alternations = 0
            self._largest = 0.0


RESTORED: Final = 3
RESTORED_NS: Final = 30 * NS_PER_S
"""Going back to the last good model so often in so long is more than a disturbance that passed."""
DRIFT_LIMIT: Final = 0.3
"""The drive may differ by this part of its range from that of the identified model,"""
DRIFT_NS: Final = 10 * NS_PER_S
"""and by more for so long."""
MEASURED_NS: Final = NS_PER_S // 10
"""How often that is measured."""

_NOTHING: Final[Sequence[Detection]] = ()


class AdaptationWatch:
    """Watches one axis; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        adaptation: What learns, `identifier.adaptation`.
        identified: The model that it started from; None for a stage not yet identified.
        position_um: Range of the displacement.
        period_ns: Period of the loop.
    """

    def __init__(
        self,
        axis: int,
        adaptation: AdaptiveIdentifier,
        identified: StageModel | None,
        position_um: AffineRange,
        period_ns: int,
    ) -> None:
        self._axis, self._position_um = axis, position_um
        self._adaptation = adaptation
        self._shadowed = adaptation if isinstance(adaptation, Shadowed) else None
        self._restored, self._restored_cycles = 0, [-inf] * RESTORED
        self._cycles = 0
        self._patience_cycles = max(RESTORED_NS // period_ns, 1)
        self._drift = ModelDrift(identified, adaptation) if identified is not None else None
        self._measured_cycles = max(MEASURED_NS // period_ns, 1)
        self._drift_cycles = max(DRIFT_NS // period_ns, 1)
        self._cycle = self._drifted_cycles = 0
        self._drifted, self._broken = 0.0, False
        self._oscillation = Oscillation(period_ns)

    def check(
        self, command_um: float, position_um: float, *, closed: bool, noise_um: float
    ) -> Sequence[Detection]:
        """Return what is wrong with the adaptation; call it once in each cycle, in the loop.

        Args:
            command_um: Displacement asked for, NaN where there is none.
            position_um: Measured displacement, NaN where the sample may not be used.
            closed: Whether the sample acts on the drive: mode `adaptive` or `trimmed`, in RUN.
            noise_um: Standard deviation of the sensor's noise.
        """
        self._cycles += 1
        self._cycle += 1
        if self._cycle >= self._measured_cycles:
            self._measure()
        restored = self._keeps_restoring()
        if not closed:
            self._oscillation.forget()
            return (Detection(Fault.D2, self._axis),) if self._broken else _NOTHING
        if isfinite(command_um) and isfinite(position_um):
            self._oscillation.update(
                self._position_um.to_unit(command_um),
                self._position_um.to_unit(position_um),
                noise_um / self._position_um.width,
            )
        drifted = self._drifted_cycles >= self._drift_cycles
        if not (restored or drifted or self._broken or self._oscillation.found):
            return _NOTHING
        return self._found(restored, drifted)

    def _keeps_restoring(self) -> bool:
        """Return whether the last good model has now been restored once too often."""
        if self._shadowed is None or self._shadowed.restored == self._restored:
            return False
        self._restored = self._shadowed.restored
        self._restored_cycles = [*self._restored_cycles[1:], self._cycles]
        return self._cycles - self._restored_cycles[0] <= self._patience_cycles

    def _measure(self) -> None:
        drifted = self._drift.measure() if self._drift else 0.0
        self._broken = not isfinite(drifted + self._adaptation.offset + self._adaptation.scale)
        over = drifted > DRIFT_LIMIT
        self._drifted_cycles = self._drifted_cycles + self._cycle if over else 0
        self._drifted, self._cycle = drifted, 0

    def _found(self, restored: bool, drifted: bool) -> Sequence[Detection]:
        found = []
        if self._broken:
            found.append(Detection(Fault.D2, self._axis))
        if restored:
            found.append(Detection(Fault.D1, self._axis, RESTORED, RESTORED - 1))
        if drifted:
            found.append(Detection(Fault.D5, self._axis, self._drifted, DRIFT_LIMIT))
        if self._oscillation.found:
            width_um, wave = self._position_um.width, self._oscillation
            found.append(
                Detection(Fault.D6, self._axis, wave.amplitude * width_um, wave.limit * width_um)
            )
        return found
