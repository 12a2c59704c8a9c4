"""Reads the dynamics in response files."""

from piezod.config.response_file import ResponseFile
from piezod.dynamics import Resonance, ResponseModel


def response_model(file: ResponseFile, period_s: float) -> ResponseModel:
    """Return the dynamics from a written voltage to the sample, with a static gain of one.

    Args:
        file: The response.
        period_s: Period for which each voltage is held, in s. The hold delays by half of it, and
            the delay of the file does not include that.
    """
    return ResponseModel(
        file.delay_s + 0.5 * period_s,
        tuple(Resonance(each.frequency_hz, each.damping, each.share) for each in file.resonances),
    )
