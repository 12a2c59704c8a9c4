"""Tests of drives within a slew rate, and of amplifiers that do not tell their own."""

import numpy as np
import pytest

from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.yaml_loader import parse_yaml
from piezod.experiment.fit.excitation import missing_excitation, recommended_drive
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.slew import slew_warnings
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up_surface import made_up_surface

RATE_HZ, RANGE_V, RANGE_UM = 1000.0, 143.0, 26.0


def drive_for(slew_v_per_s: float) -> FloatArray:
    """Return the recommended drive over time, in V."""
    text = recommended_drive(0.0, RANGE_V, slew_v_per_s)
    data = parse_yaml(text, "recommended").data["identification"]
    config = IdentificationConfig.model_validate(data)
    t_s = np.arange(round(config.duration_s * RATE_HZ)) / RATE_HZ
    return np.array(config.drive_v.built(config.duration_s).sample(t_s))


def record_of(drive_v: FloatArray, output_v: FloatArray) -> Record:
    """Return a record of a stage that gets another voltage than its amplifier reports."""
    drives = np.clip(output_v / RANGE_V, 0.0, 1.0)
    x = SurfaceForm().positions_at(made_up_surface(), drives)
    return Record(np.arange(x.size) / RATE_HZ, drive_v, RANGE_UM * x)


def limited(drive_v: FloatArray, slew_v_per_s: float) -> FloatArray:
    """Return the output of an amplifier with a limited slew rate, in V."""
    output_v, step_v = drive_v.copy(), slew_v_per_s / RATE_HZ
    for k in range(1, drive_v.size):
        output_v[k] = output_v[k - 1] + np.clip(drive_v[k] - output_v[k - 1], -step_v, step_v)
    return output_v


def filtered(drive_v: FloatArray, frequency_hz: float) -> FloatArray:
    """Return the output of an amplifier with a filter of first order, in V."""
    output_v, gain = drive_v.copy(), -np.expm1(-2.0 * np.pi * frequency_hz / RATE_HZ)
    for k in range(1, drive_v.size):
        output_v[k] = output_v[k - 1] + gain * (drive_v[k] - output_v[k - 1])
    return output_v


@pytest.mark.parametrize("slew_v_per_s", [300.0, 1000.0, 20_000.0])
def test_recommended_drive_stays_below_the_slew_rate(slew_v_per_s: float) -> None:
    """It starts and ends at the lowest voltage, and still has all excitation."""
    drive_v = drive_for(slew_v_per_s)

    assert np.abs(np.diff(drive_v)).max() * RATE_HZ < 0.81 * slew_v_per_s
    assert (drive_v[0], drive_v[-1]) == pytest.approx((0.0, 0.0), abs=0.1)
    assert missing_excitation(record_of(drive_v, drive_v)) == ()


def test_drive_that_is_slow_enough_is_the_usual_one() -> None:
    """Nothing is slower than it has to be."""
    assert recommended_drive(0.0, RANGE_V, 20_000.0) == recommended_drive(0.0, RANGE_V)


@pytest.mark.parametrize("slew_v_per_s", [700.0, 1000.0])
def test_flat_top_of_the_speed_is_recognised(slew_v_per_s: float) -> None:
    """The warning names the slew rate."""
    drive_v = drive_for(np.inf)

    (warning,) = slew_warnings(record_of(drive_v, limited(drive_v, slew_v_per_s)))

    assert "slew" in warning


@pytest.mark.parametrize("frequency_hz", [np.inf, 40.0, 8.0, 3.0])
def test_filter_is_no_limit_of_the_slew_rate(frequency_hz: float) -> None:
    """It makes fast motion smaller and later, without a flat top."""
    drive_v = drive_for(np.inf)
    output_v = drive_v if frequency_hz == np.inf else filtered(drive_v, frequency_hz)

    assert not [*slew_warnings(record_of(drive_v, output_v))]
