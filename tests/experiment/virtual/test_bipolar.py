"""Tests of experiments on a stage that rests inside its range, beside its unipolar twin."""

from pathlib import Path

import pytest

from piezod.config.model_file import dump_model
from piezod.config.modes import Mode
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from tests.conftest import Figure
from tests.control.make_models import as_file
from tests.experiment.twins import BIPOLAR, UNIPOLAR, errors_pct, twin


@pytest.mark.stress
@pytest.mark.parametrize("method", ["surface", "least-squares"])
@pytest.mark.parametrize("mode", [Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED])
def test_bipolar_stage_follows_as_its_unipolar_twin(
    figure: Figure, method: str, mode: Mode
) -> None:
    """In every case, whatever the cases before have left."""
    twins = (twin(*UNIPOLAR, method), twin(*BIPOLAR, method))
    unipolar_pct, bipolar_pct = (errors_pct(config, mode) for config in twins)

    figure(f"{method}, {mode}, rms %: unipolar {unipolar_pct}, bipolar {bipolar_pct}")
    assert max(bipolar_pct) < 1.3 * max(unipolar_pct) + 0.05


def test_bipolar_stage_with_a_model_from_a_file_is_conditioned_first(tmp_path: Path) -> None:
    """Where its voltage has been before the experiment is not known."""
    config, path = twin(*BIPOLAR), tmp_path / "model.yaml"
    with opened(config, lambda _further_s: None) as stage:
        model = identify_axes(stage, config)["x"].model
    path.write_text(dump_model(as_file(model)), encoding="utf-8")
    axis = config.axes["x"].model_copy(update={"model": path})
    known = config.model_copy(update={"axes": {"x": axis}, "identification": None})

    assert max(errors_pct(known, Mode.FEEDFORWARD)) < 0.4
