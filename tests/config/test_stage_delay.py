"""The delay of an axis of a stage that has no model file."""

from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.devices import registry
from piezod.errors import ConfigError

SIMULATED = Path(__file__).parents[2] / "config" / "simulated.yaml"
MODEL = "    model: models/simulated-stack.yaml # made by `piezod identify`\n"


def test_negative_delay_needs_a_model_file(tmp_path: Path) -> None:
    """Without a model there is no surface, to which a negative delay could belong."""
    text = SIMULATED.read_text(encoding="utf-8")
    assert MODEL in text
    path = tmp_path / "stage.yaml"
    text = text.replace(MODEL, "").replace("{identifier: rls,", "{delay_s: -0.05,")
    path.write_text(text, encoding="utf-8")

    with pytest.raises(ConfigError) as caught:
        load_daemon(path, registry)

    (problem,) = caught.value.problems
    assert problem.path == "axes.x.compensator.delay_s"
    assert problem.what == "out of range (got -0.05 s), allowed range 0 to 1 s"
