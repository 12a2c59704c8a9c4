"""Tests of the error if an axis cannot be identified."""

import pytest

from piezod.errors import DataError
from piezod.experiment.virtual.run import run_experiment
from tests.experiment.conftest import Load

LATE = """\
  late:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    compensator: {delay_s: 0.5}
"""


def test_error_names_the_axis(load: Load, short: str) -> None:
    """A record that no model fits is refused with the name of its axis."""
    config = load(short.replace("identification:", LATE + "identification:"))

    with pytest.raises(DataError, match=r"^axis late: position_um does not grow with the drive"):
        run_experiment(config, "", "", lambda _label, _share: None)
