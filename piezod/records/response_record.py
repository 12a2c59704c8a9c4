"""The measured response of an axis, with its model, as it is drawn and written."""

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from piezod.dynamics.fitting import ResponseFit
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.steps import StepAnswer
from piezod.records.frozen import FloatArray


@dataclass(frozen=True, kw_only=True)
class AboutVoltage:
    """The measurement about one voltage.

    Attributes:
        offset_v: The voltage, in V.
        amplitude_v: Largest deviation from it, in V.
        response: Displacement over voltage, in µm/V; the hold of the voltage is counted as no
            delay.
        noise_hz: (n,) frequencies of the noise, in Hz.
        noise_um_per_rthz: (n,) noise of the displacement, in µm/√Hz.
        step: Mean answer to steps; None if there was none.
    """

    offset_v: float
    amplitude_v: float
    response: MeasuredResponse
    noise_hz: FloatArray
    noise_um_per_rthz: FloatArray
    step: StepAnswer | None


@dataclass(frozen=True, kw_only=True)
class ResponseRecord:
    """The measurements of an axis, and the model that was fitted to all of them.

    Attributes:
        axis: Name of the axis.
        title: Where the data are from, for people.
        method: How they were measured.
        rate_hz: Samples per second.
        about: The measurement about each voltage.
        fit: The model; its delay does not include the hold.
        warnings: Warnings, a sentence each.
    """

    axis: str
    title: str
    method: Literal["multisine", "recording"]
    rate_hz: float
    about: tuple[AboutVoltage, ...]
    fit: ResponseFit
    warnings: tuple[str, ...]


def without_hold(response: MeasuredResponse, rate_hz: float) -> MeasuredResponse:
    """Return a response from a written voltage, from that of samples and voltages in force.

    A sample belongs to the voltage that was in force when it was taken, written a period before.
    That voltage acts, on average, half a period after it was written. The delay from the voltage to
    its effect is therefore half a period longer than that from sample to sample.

    Args:
        response: From the voltage in force at each sample.
        rate_hz: Samples per second.
    """
    turned = np.exp(-1j * pi * response.frequency_hz / rate_hz)
    return MeasuredResponse(
        response.frequency_hz, response.response * turned, response.variance, response.coherence
    )
