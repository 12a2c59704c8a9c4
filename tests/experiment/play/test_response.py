"""The response that is measured by a play, and the task that follows from it."""

import numpy as np
import pytest

from piezod.config.response_file import ResonanceConfig, ResponseFile
from piezod.errors import DataError
from piezod.experiment.play.response import (
    MultisineSettings,
    measure_response,
    stored_response,
)
from piezod.experiment.play.task import KnownAxis, left_out_share
from tests.experiment.play.rig_axis import (
    INTERVAL_NS,
    RESPONSE,
    SENSOR_DELAY_S,
    SETTINGS,
    RigAxis,
    known_response,
    maker,
    model,
    sine,
)

SETTINGS_OF_MULTISINE = MultisineSettings(INTERVAL_NS, 10.0, 3000.0, 0.03)


def test_measured_response_is_that_of_the_rig() -> None:
    """Mode and delay are found to 1 %; the delay has the hold of a point, and the static gain is 1.

    Amplifier 52 µs, hold 25 µs, sensor 171 µs.
    """
    range_um = model().position_um
    known = measure_response(RigAxis(), maker(), range_um, SETTINGS_OF_MULTISINE)
    mode = known.model.resonances[0]

    assert mode.frequency_hz == pytest.approx(807.0, rel=0.002)
    assert mode.damping == pytest.approx(0.0291, rel=0.05)
    assert known.model.delay_s == pytest.approx(248e-6, abs=6e-6)
    assert 2000.0 < known.highest_hz <= 3000.0
    assert known.at(np.array([0.0])) == pytest.approx([1.0])
    frequency_hz = np.array([100.0, 500.0, 3001.0])
    assert known.uncertainty(frequency_hz) == pytest.approx([0.0, 0.0, np.inf], abs=0.05)


def test_stuck_sensor_shows_no_response() -> None:
    """A record without any motion is refused by name."""
    axis = RigAxis()
    axis.spoil(lambda record: record._replace(position_um=np.full_like(record.position_um, 3.0)))

    with pytest.raises(DataError, match="stuck"):
        measure_response(axis, maker(), model().position_um, SETTINGS_OF_MULTISINE)


def test_response_of_a_file_gets_the_hold_of_a_point() -> None:
    """A point is held for one interval, which delays its middle by half of it."""
    file = ResponseFile(
        created_at="2026-01-01T00:00:00+00:00",
        created_by="test",
        method="multisine",
        rate_hz=20_000.0,
        low_hz=10.0,
        high_hz=2000.0,
        coherence_low=0.9,
        coherence_high=1.0,
        delay_s=223e-6,
        resonances=(ResonanceConfig(frequency_hz=807.0, damping=0.0291),),
    )
    known = stored_response(file, INTERVAL_NS)
    frequency_hz = np.array([10.0, 200.0, 1500.0])

    assert known.at(frequency_hz) == pytest.approx(RESPONSE.at(frequency_hz), rel=0.01)
    assert known.uncertainty(np.array([1500.0, 2500.0])).tolist() == [0.0, np.inf]


def test_command_loses_what_is_not_known() -> None:
    """Harmonics beyond the response are left out, and the task says how much of the swing."""
    triangle = sine(100.0)
    triangle = triangle._replace(values_um=4 + 20 * (1 - np.abs(1 - np.arange(200) / 100)))
    axis = KnownAxis(maker(), model().creep, known_response(), SENSOR_DELAY_S)
    task = axis.task(triangle, SETTINGS)

    assert 0.003 < left_out_share(task.given, task.command) < 0.01
    assert task.given is triangle
    spectrum = np.abs(np.fft.rfft(task.command.values_um))
    assert spectrum[triangle.harmonics_hz > 2850.0].max() < 1e-9


def test_command_that_is_not_known_at_all_is_refused() -> None:
    """A sine beyond the response would not be commanded at all."""
    narrow = known_response()._replace(highest_hz=150.0)
    axis = KnownAxis(maker(), model().creep, narrow, SENSOR_DELAY_S)

    with pytest.raises(DataError, match="known up to 150 Hz"):
        axis.task(sine(200.0), SETTINGS)
