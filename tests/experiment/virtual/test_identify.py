"""Tests of the error if an axis cannot be identified."""

import pytest

from piezod.errors import DataError
from piezod.experiment.virtual.run import run_experiment
from tests.experiment.conftest import SLOW_LOOP, Load

LATE = """\
  late:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    compensator: {delay_s: 0.5}
"""


def test_error_names_the_axis(load: Load) -> None:
    """A record that no model fits is refused with the name of its axis."""
    config = load(SLOW_LOOP.replace("identification:", LATE + "identification:"))

    with pytest.raises(DataError, match=r"^axis late: position_um does not grow with the drive"):
        run_experiment(config, "", "", lambda _label, _share: None)


@pytest.mark.parametrize(
    ("trim", "modes", "warned"),
    [
        ("{authority_pct: 0.1}", "[feedforward, trimmed]", True),
        ("{authority_pct: 0.1, base: adaptive}", "[feedforward, trimmed]", False),
        ("{authority_pct: 0.1}", "[feedforward, adaptive]", False),
        ("{authority_pct: 20}", "[feedforward, trimmed]", False),
    ],
)
def test_trim_that_is_too_weak_for_its_model_has_a_warning(
    load: Load, trim: str, modes: str, warned: bool
) -> None:
    """The error of the model on held-out positions is compared with what the trim may remove."""
    changed = f"    trim: {trim}\nmodes: {modes}\nidentification:"

    result = run_experiment(
        load(SLOW_LOOP.replace("identification:", changed)), "", "", lambda _label, _share: None
    )

    about = [text for text in result.warnings if "removes at most 0.1 %, its `authority" in text]
    assert len(about) == warned
    assert all(
        text.startswith("Axis x: The model predicts held-out positions to") for text in about
    )
