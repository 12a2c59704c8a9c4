"""A daemon whose model was identified in a slower loop."""

from pathlib import Path

import pytest

from piezod.config.model_file import dump_model, load_model
from piezod.config.modes import Mode
from piezod.control.law.axis import CompensatedAxis
from piezod.control.law.compensated import Start, compensated_axis
from piezod.control.law.model_files import read_model
from piezod.devices.interface import Sample
from tests.control.rig_stage import RigStage, shipped_config, with_axis

PERIOD_NS = 100_000


def errors_of(law: CompensatedAxis) -> list[float]:
    """Return the errors of the identified model for samples while a ramp is driven."""
    errors = []
    for cycle in range(60):
        t_ns = cycle * PERIOD_NS
        law.force(1.0 * cycle)
        law.applied(law.update(t_ns, Sample(t_ns, 0.1 * cycle, True)).drive_v)
        errors.append(law.identifier.error_of(law.proof.first))
    return errors


def test_daemon_pairs_samples_with_voltages_as_an_experiment(tmp_path: Path) -> None:
    """There the mode rang and hid the delay of the sensor, which its data sheet has."""
    shipped = shipped_config().axes["x"].model
    assert shipped is not None
    found = load_model(shipped).model_copy(update={"delay_s": -4e-4, "held_s": 1e-3})
    path = tmp_path / "model.yaml"
    path.write_text(dump_model(found), encoding="utf-8")
    config = with_axis(shipped_config(), model=path).model_copy(update={"rate_hz": 10_000.0})
    axis, model = config.axes["x"], read_model(path)[0].zeroed_at(0.0)
    rest, start = model.at_rest(0.0, 1e-4), Start(0, PERIOD_NS, 0.0)
    law = compensated_axis(axis, model, rest, Mode.FEEDFORWARD, lambda _t_s: 0.0, start)

    assert errors_of(RigStage(config).stage.axes[0].law) == pytest.approx(errors_of(law), abs=1e-9)
