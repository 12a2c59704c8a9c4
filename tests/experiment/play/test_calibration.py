"""What the calibration of the sensor does to a true error, and the zero of a play."""

import numpy as np
import pytest

from piezod.devices.played_axis import AxisPlayRecord, AxisTable
from piezod.dynamics.model import ResponseModel
from piezod.experiment.play.calibration import sensor_limit
from piezod.experiment.play.record import CountedPeriods
from piezod.experiment.play.stage import AtRest
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.hysteresis.memory import FloatArray
from tests.experiment.play.rig_axis import INTERVAL_NS, sine

COMMAND = sine()
SENSOR = ResponseModel(171e-6).at(COMMAND.harmonics_hz)
RNG = np.random.default_rng(7)


def seen(true_um: FloatArray) -> FloatArray:
    """Return the samples of an exact sensor, delayed as the real one."""
    return np.fft.irfft(np.fft.rfft(true_um) * SENSOR, true_um.shape[-1])


def test_calibration_is_told_from_noise_and_from_errors_of_the_motion() -> None:
    """The calibration error of 0.1 % is found; what an exact sensor would leave is the rest."""
    rest_um = 0.01 * np.sin(6.0 * np.pi * np.arange(100) / 100)

    def error_um(position_um: FloatArray) -> FloatArray:
        return 0.02 * np.sin(0.3 * position_um)

    # A learned motion: the samples are on the command, so the displacement is not.
    true_um = COMMAND.values_um - error_um(COMMAND.values_um) + rest_um
    measured_um = seen(true_um) + error_um(seen(true_um))
    noise_um = 0.02 * RNG.standard_normal((40, 100))
    periods = CountedPeriods(measured_um + noise_um, np.tile(true_um, (40, 1)))
    limit = sensor_limit(periods, COMMAND.values_um, SENSOR)

    assert limit.calibration_pct == pytest.approx(0.1, abs=0.02)
    assert limit.apart_pct == pytest.approx(0.05, abs=0.02)


def test_limit_is_unknown_without_the_truth() -> None:
    """A real device does not know the displacement."""
    unknown = np.full((4, 100), np.nan)
    limit = sensor_limit(CountedPeriods(unknown, unknown), COMMAND.values_um, SENSOR)

    assert np.isnan(limit).all()


class NoisyRest:
    """Implements `PlayedStage`: an axis at rest, 0.3 µm from the zero of the loop."""

    def __init__(self) -> None:
        self.durations_ns: list[int] = []

    def rest(self) -> AtRest:
        return AtRest(0.0, 1.0)

    def play(self, table: AxisTable) -> AxisPlayRecord:
        self.durations_ns.append(table.duration_ns)
        n = table.lead_in_v.size + table.period_v.size * table.cycles
        position_um = 0.3 + 0.1 * RNG.standard_normal(n)
        position_um[-1] = np.nan
        return AxisPlayRecord(table.interval_ns, position_um, np.full(n, np.nan), 0)


def test_zero_is_the_mean_of_a_play_at_rest() -> None:
    """A second of samples has a mean with a thirtieth of the noise of a zero of the loop."""
    axis = ZeroedAxis(NoisyRest(), INTERVAL_NS)
    record = axis.play(AxisTable(INTERVAL_NS, np.empty(0), np.ones(20_000), 1))

    assert axis.rest().drive_v == 1.0
    assert np.nanmean(record.position_um) == pytest.approx(0.0, abs=5e-3)
    assert np.isnan(record.true_um).all()


@pytest.mark.parametrize("interval_ns", [INTERVAL_NS, 300_000, 100_000_000, 700_000_000])
def test_play_at_rest_lasts_about_a_second(interval_ns: int) -> None:
    """A long interval means fewer points, and not a longer play."""
    axis = NoisyRest()
    ZeroedAxis(axis, interval_ns)

    assert axis.durations_ns[0] == pytest.approx(1e9, rel=0.31)


def test_axis_is_conditioned_before_it_is_zeroed() -> None:
    """What relaxes along the path is brought to its rest first, in a play of its own."""
    axis, swing_v = NoisyRest(), np.linspace(1.0, 150.0, 4_000)
    ZeroedAxis(axis, INTERVAL_NS, AxisTable(INTERVAL_NS, np.empty(0), swing_v, 3))

    conditioning_ns, zeroing_ns = axis.durations_ns
    assert conditioning_ns == 3 * swing_v.size * INTERVAL_NS
    assert zeroing_ns == pytest.approx(1e9, rel=0.31)
