"""Adaptation in the loop: pairs samples with voltages, normalises both, takes the creep out."""

from piezod.control.law.creep_state import AT_REST, CreepState
from piezod.control.law.gate import LearningGate
from piezod.control.law.history import DriveHistory
from piezod.devices.interface import Sample
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.lms import Convergence
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.normalisation import AffineRange


class Identifier:
    """Follows one axis; its weights are what the compensator adopts or follows.

    Args:
        adaptation: The algorithm, with the weights to start from.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        history: Voltages in force, kept by the axis.
        delay_ns: How long the displacement lags behind the voltage.
        convergence: When the weights count as converged.
        gate: Which samples may teach.
        creep: How far the stage has crept, and where it is.
    """

    def __init__(
        self,
        adaptation: AdaptiveIdentifier,
        drive_v: AffineRange,
        position_um: AffineRange,
        history: DriveHistory,
        delay_ns: int,
        convergence: Convergence,
        gate: LearningGate,
        creep: CreepState = AT_REST,
    ) -> None:
        self.adaptation, self.gate = adaptation, gate
        self._drive_v, self._position_um = drive_v, position_um
        self._history, self._delay_ns = history, delay_ns
        self._convergence = convergence
        self._creep, self._zeroed = creep.creep, creep.zeroed
        self._lags, self._quick = creep.lags.copy(), creep.quick
        self.eased = self._left_out = False
        """Whether only every second sample that can teach does."""
        self.converged = False
        """Whether the weights have converged, over a window and up to the last sample."""

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); they change in place."""
        return self.adaptation.weights

    @property
    def offset(self) -> float:
        """Drift of the displacement, in units of the range; 0 where it is not identified."""
        return self.adaptation.offset

    @property
    def scale(self) -> float:
        """By how much more than the displacement the hysteresis sees; 0 if not identified."""
        return self.adaptation.scale

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return self.adaptation.merged_pairs

    def zero(self) -> None:
        """Count from here on: the stage rests, and its sensor was zeroed; call it in the loop."""
        self._zeroed = float(self._creep.weights @ self._lags)

    def learn(self, t_ns: int, sample: Sample, *, limited: bool, expected: float) -> None:
        """Take the sample of this cycle; adapt if it can teach; may be called in the loop.

        Where the sample is not accurate the memory goes on with what the compensator expects:
        the stage moves all the same, and an extremum that was missed would be wrong for long.

        Args:
            t_ns: Instant of the cycle.
            sample: What was measured.
            limited: Whether range or slew rate cut off part of the drive that is in force.
            expected: Displacement that the compensator's memory has, normalised.
        """
        lags, gains, weights = self._lags, self._creep.gains, self._creep.weights
        crept = advance_creep(lags, gains, weights, self._quick)
        position = self._position_um.to_unit(sample.position_um)
        drive = self._drive_v.to_unit(self._history.at(sample.t_ns - self._delay_ns))
        may_teach = self.gate.admits(
            valid=sample.valid,
            age_ns=t_ns - sample.t_ns,
            limited=limited,
            drive=drive,
            position=position,
        )
        if self.eased and may_teach:
            self._left_out = not self._left_out
            may_teach = not self._left_out
        # What creeps is what the hysteresis sees: so has crept in its units, not in the sensor's.
        seen = position + self._zeroed - crept / (1.0 + self.scale)
        if not self.gate.accurate:
            seen = (expected + self.offset) / (1.0 + self.scale)
        before = self.adaptation.position
        error = self.adaptation.step(seen, drive, may_teach)
        self._quick = (1.0 + self.scale) * seen - self.offset
        if may_teach and self.adaptation.position != before:  # at rest any weights predict well
            self.converged = self._convergence.update(error)
