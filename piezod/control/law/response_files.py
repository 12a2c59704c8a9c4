"""Reads the dynamics in response files."""

from piezod.config.response_file import ResponseFile
from piezod.dynamics import Resonance, ResponseModel


def response_model(file: ResponseFile) -> ResponseModel:
    """Return the dynamics from a voltage at the output to the sample, without the hold.

    The static gain is one.
    """
    return ResponseModel(
        file.delay_s,
        tuple(Resonance(each.frequency_hz, each.damping, each.share) for each in file.resonances),
    )
