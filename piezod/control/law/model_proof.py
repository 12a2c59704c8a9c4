"""Compares the learned model with the identified one while the stage follows a command."""

from math import sqrt
from typing import Final

from piezod.control.signals import RecentRange
from piezod.hysteresis import LearnedModel
from piezod.hysteresis.adaptation import Adaptable

LEAST_ERROR: Final = 0.01
"""A learned model with an rms error up to this share of the range is never worse."""
TOLERANCE: Final = 2.0
"""Ratio of the mean squared errors above which the learned model is worse."""


class ModelProof:
    """Keeps the last learned model that has proved itself. Fixed memory. Real-time safe.

    Over a window of cycles, the tracking error and the error of the first model alone are compared.
    If the learned model was not worse, the model from the start of the window is proven. If it was
    worse, the first model is the proven one again.

    Args:
        first: The model from the identification.
        window_cycles: Number of cycles between two comparisons.
        lag_cycles: An error that this many cycles of delay explain does not count.
    """

    def __init__(self, first: LearnedModel, window_cycles: int, lag_cycles: int) -> None:
        self.first, self.proven = first, LearnedModel.of(first)
        """The model from the identification, and the last model that has proved itself."""
        self._candidate = LearnedModel.of(first)  # in use at the start of the window
        self._window_cycles = window_cycles
        self._command = RecentRange(lag_cycles + 1)
        self._cycles, self._squares, self._first_squares = 0, 0.0, 0.0
        self._verdict: tuple[float, float] | None = None

    def restart(self, first: LearnedModel) -> None:
        """Start again with another first model."""
        for model in (self.first, self.proven, self._candidate):
            model.assign(first)
        self._begin_window()

    def add(self, command: float, error: float, first_error: float, in_use: Adaptable) -> bool:
        """Take one cycle; return whether a window has ended with a worse model in use.

        Args:
            command: Command, in units of the range.
            error: Command minus position at the instant of the sample, in units of the range.
            first_error: Drive minus its prediction by the first model, in units of the range. The
                slope of a model is near one, so this is an error of the position, too.
            in_use: The learned model in use.
        """
        if self._cycles == 0:
            self._candidate.assign(in_use)
        self._command.add(command)
        beyond_lag = max(abs(error) - self._command.swing, 0.0)
        self._squares += beyond_lag * beyond_lag
        self._first_squares += first_error * first_error
        self._cycles += 1
        return self._cycles >= self._window_cycles and self._compare()

    def take_verdict(self) -> tuple[float, float] | None:
        """Return the tracking error of a worse model and its limit, once; None if there was none.

        Both are rms over a window, in units of the range.
        """
        verdict, self._verdict = self._verdict, None
        return verdict

    def _compare(self) -> bool:
        """Judge the window that ends, and begin the next one; return whether it was worse."""
        square = self._squares / self._cycles
        limit = max(TOLERANCE * self._first_squares / self._cycles, LEAST_ERROR**2)
        worse = not square <= limit  # so that NaN is worse
        self.proven.assign(self.first if worse else self._candidate)
        if worse:
            self._verdict = sqrt(square), sqrt(limit)
        self._begin_window()
        return worse

    def _begin_window(self) -> None:
        self._cycles, self._squares, self._first_squares = 0, 0.0, 0.0
