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
    """The measurement about one voltage."""

    offset_v: float  #: The voltage, in V.
    amplitude_v: float  #: Largest deviation from it, in V.
    #: Displacement over voltage, in µm/V; the hold of the voltage is counted as no delay.
    response: MeasuredResponse
    noise_hz: FloatArray  #: (n,) frequencies of the noise, in Hz.
    noise_um_per_rthz: FloatArray  #: (n,) noise of the displacement, in µm/√Hz.
    step: StepAnswer | None  #: Mean answer to steps; None if there was none.


@dataclass(frozen=True, kw_only=True)
class ResponseRecord:
    """The measurements of an axis, and the model that was fitted to all of them."""

    axis: str  #: Name of the axis.
    title: str  #: Where the data are from, for people.
    method: Literal["multisine", "recording"]  #: How they were measured.
    rate_hz: float  #: Samples per second.
    about: tuple[AboutVoltage, ...]  #: The measurement about each voltage.
    fit: ResponseFit  #: The model; its delay does not include the hold.
    warnings: tuple[str, ...]  #: Warnings, a sentence each.


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
