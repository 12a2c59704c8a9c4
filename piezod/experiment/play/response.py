"""The response of an axis to its table, measured by playing a multisine about mid-range."""

from typing import NamedTuple

import numpy as np

from piezod.config.response_file import ResponseFile
from piezod.control.law.response_files import response_model
from piezod.dynamics.fitting import fit_response
from piezod.dynamics.harmonics import MEASURED_SHIFT, STORED_SHIFT
from piezod.dynamics.measured import from_periods
from piezod.dynamics.model import ComplexArray, ResponseModel
from piezod.dynamics.multisine import low_peak_multisine, odd_harmonics
from piezod.errors import DataError
from piezod.experiment.play.command import points_of
from piezod.experiment.play.record import counted_periods
from piezod.experiment.play.stage import PlayedStage
from piezod.experiment.play.tables import TableMaker
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

LINES = 120
"""Number of lines of the multisine, at most."""
SETTLING, COUNTED = 10, 20
"""Periods of the multisine before those that count, and those that count."""
SIGMAS = 2.0
"""A fitted response misses a measured line beyond this many standard uncertainties."""


class MultisineSettings(NamedTuple):
    """Settings of the measurement."""

    interval_ns: int  #: Time between two points of the table, in ns.
    lowest_hz: float  #: Lowest frequency, in Hz; a period lasts its inverse.
    highest_hz: float  #: Highest frequency, in Hz.
    amplitude: float  #: Largest deviation of the position, as a share of the range of the model.


LOWEST_HZ, HIGHEST_HZ = 10.0, 3000.0
"""Frequencies of the usual multisine."""
HIGHEST_SHARE = 0.15
"""Its highest frequency, as a share of the rate of the table, if that is lower."""


def usual_multisine(interval_ns: int, amplitude: float) -> MultisineSettings:
    """Return the multisine that measures an axis of which nothing is known.

    Args:
        interval_ns: Time between two points of the table, in ns.
        amplitude: As in the settings.
    """
    highest_hz = min(HIGHEST_HZ, HIGHEST_SHARE * NS_PER_S / interval_ns)
    # The clocks of some devices, of 24 µs for example, do not divide a period of 0.1 s.
    n_points = max(round(NS_PER_S / LOWEST_HZ / interval_ns), 1)
    lowest_hz = NS_PER_S / (n_points * interval_ns)
    return MultisineSettings(interval_ns, lowest_hz, highest_hz, amplitude)


class KnownResponse(NamedTuple):
    """The response from the input of the inverse model to the samples."""

    model: ResponseModel  #: The response, with a static gain of one.
    highest_hz: float  #: Highest frequency at which it is known, in Hz.
    #: (n,) frequencies of the measurement, in Hz; empty for a response from a file.
    frequency_hz: FloatArray
    misfit: FloatArray  #: (n,) relative error of the model there, beyond the noise.
    shift: float  #: Share by which the frequencies of its modes may be wrong.
    #: Time for which a point is held, in s, if the model does not contain it, else 0.
    hold_s: float = 0.0

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the response at frequencies in Hz, shape (n,)."""
        turns = frequency_hz * self.hold_s
        hold = np.exp(-1j * np.pi * turns) * np.sinc(turns)
        return np.asarray(self.model.at(frequency_hz) * hold)

    def uncertainty(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the relative error at frequencies in Hz, shape (n,); inf where it is not known."""
        error = np.zeros(frequency_hz.size)
        if self.frequency_hz.size:
            error = np.interp(frequency_hz, self.frequency_hz, self.misfit)
        return np.where(frequency_hz <= self.highest_hz, error, np.inf)


def stored_response(response: ResponseFile, interval_ns: int) -> KnownResponse:
    """Return the response of a file, for tables of an interval in ns.

    The delay of a file does not contain the hold of the voltage; a point is held for an interval.
    """
    nothing, hold_s = np.empty(0), interval_ns / NS_PER_S
    model = response_model(response)
    return KnownResponse(model, response.high_hz, nothing, nothing, STORED_SHIFT, hold_s)


def measure_response(
    stage: PlayedStage,
    maker: TableMaker,
    range_um: tuple[float, float],
    settings: MultisineSettings,
) -> KnownResponse:
    """Play a multisine through the inverse model, and fit a response to the record.

    The inverse model removes most of the loops, so that the record shows the dynamics.

    Raises:
        DataError: If the record cannot be used, or does not show the response.
        DeviceError: If the play failed.
    """
    low_um, high_um = range_um
    n = points_of("the multisine", 1.0 / settings.lowest_hz, settings.interval_ns)
    period_s = n * settings.interval_ns / NS_PER_S
    highest = int(settings.highest_hz * period_s)
    multisine = low_peak_multisine(odd_harmonics(1, highest, LINES))
    deviation = multisine.sample(np.arange(n) / n) / multisine.peak
    wanted_um = 0.5 * (low_um + high_um) + settings.amplitude * (high_um - low_um) * deviation
    table = maker.table(wanted_um, stage.rest().drive_v, SETTLING + COUNTED)
    position_um = counted_periods(stage.play(table), table, COUNTED).position_um
    if np.ptp(position_um) == 0.0:
        raise DataError("the sensor is stuck: all samples of the multisine are equal")
    given_um = np.tile(wanted_um, (COUNTED, 1))
    measured = from_periods(given_um, position_um, multisine.harmonics, period_s)
    fit = fit_response([measured])
    used = fit.used[0]
    fitted = fit.model.at(used.frequency_hz) * fit.slow_part(0, used.frequency_hz)
    missed = np.abs(used.response / fitted - 1.0) - SIGMAS * used.relative_uncertainty
    misfit = np.maximum(missed, 0.0)
    return KnownResponse(fit.model, fit.high_hz, used.frequency_hz, misfit, MEASURED_SHIFT)
