"""Figures from elsewhere that errors are compared with."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from piezod.records.recording import Recording


@dataclass(frozen=True)
class Reference:
    """Errors that somebody else reached, and that ours should not exceed.

    Attributes:
        label: Whose they are, for people, as in "paper".
        values: Error by (case, mode), in the unit of the metrics.
        metrics: Names of the metrics that are compared with them.
    """

    label: str
    values: Mapping[tuple[str, str], float]
    metrics: tuple[str, ...]

    def value(self, recording: Recording) -> float | None:
        """Return the error to compare a recording with, None where there is none.

        Args:
            recording: The recording.
        """
        return self.values.get((recording.case, recording.mode))

    def limit(self, recording: Recording, metric: str) -> float | None:
        """Return what a metric of a recording should not exceed, None where nothing is said.

        Args:
            recording: The recording.
            metric: Name of the metric.
        """
        return self.value(recording) if metric in self.metrics else None


def is_missed(value: float, limit: float | None) -> bool:
    """Return whether an error exceeds its limit, or is no number where it has one, or is infinite.

    Args:
        value: The error.
        limit: What it should not exceed, None where nothing is said.
    """
    if math.isnan(value):
        return limit is not None
    return math.isinf(value) or (limit is not None and value > limit)
