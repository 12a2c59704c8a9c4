"""Adaptation in the loop: pairs samples with voltages, normalises both, runs the paper's LMS."""

from piezod.control.drive_history import DriveHistory
from piezod.devices.interface import Sample
from piezod.hysteresis.lms import Convergence, LMSIdentifier
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.normalisation import AffineRange


class Identifier:
    """Follows one axis; its weights are what the compensator adopts or follows.

    Args:
        lms: The algorithm, with the weights to start from.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        history: Voltages in force, kept by the axis.
        delay_ns: How long the displacement lags behind the voltage.
        convergence: When the weights count as converged.
    """

    def __init__(
        self,
        lms: LMSIdentifier,
        drive_v: AffineRange,
        position_um: AffineRange,
        history: DriveHistory,
        delay_ns: int,
        convergence: Convergence,
    ) -> None:
        self._lms = lms
        self._drive_v, self._position_um = drive_v, position_um
        self._history, self._delay_ns = history, delay_ns
        self._convergence = convergence
        self.converged = False
        """Whether the weights have converged, over a window and up to the last sample."""

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); they change in place."""
        return self._lms.weights

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return self._lms.merged_pairs

    def learn(self, sample: Sample) -> None:
        """Adapt to one sample; an invalid one teaches nothing; may be called in the loop."""
        if not sample.valid:
            return
        drive_v = self._history.at(sample.t_ns - self._delay_ns)
        before = self._lms.position
        error = self._lms.step(
            self._position_um.to_unit(sample.position_um), self._drive_v.to_unit(drive_v)
        )
        if self._lms.position != before:  # at rest any weights predict the next error
            self.converged = self._convergence.update(error)
