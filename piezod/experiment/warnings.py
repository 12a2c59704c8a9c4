"""Warnings for the reader of a run, each with a remedy."""

from collections.abc import Iterator

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.frequencies import coarse
from piezod.records.experiment_result import Recording


def rate_warnings(config: ExperimentConfig, rate_hz: float) -> Iterator[str]:
    """Yield the warnings about commands that are fast for the loop."""
    for case in config.cases:
        for warning in coarse(case.commands(config.axes), rate_hz):
            yield f"{case.name}, {warning}"


def run_warnings(recording: Recording, merged_pairs: int) -> Iterator[str]:
    """Yield the warnings about a run.

    Args:
        recording: The recording.
        merged_pairs: Pairs of extrema that the memories of compensator and identifier have removed,
            in total.
    """
    run = f"{recording.case}, {recording.mode}, axis {recording.axis}:"
    invalid = np.count_nonzero(~np.isfinite(recording.position_um))
    if invalid:
        share_pct = 100.0 * invalid / recording.t_s.size
        yield (
            f"{run} {invalid} of {recording.t_s.size} samples, {share_pct:.2g} %, were invalid, "
            "and count in no error. Check that the sensor stays in its range."
        )
    if merged_pairs:
        yield (
            f"{run} a memory was full and removed {merged_pairs} pairs of extrema, those of the "
            "smallest loops, whose hysteresis is compensated less well. Command fewer loops inside "
            "each other, or raise deadband_pct above the sensor's noise."
        )
