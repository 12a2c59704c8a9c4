"""Tests of the five lines about a model."""

from dataclasses import replace

import pytest

from piezod.experiment.fit.file import FileFit, identify_file
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.verdict import Usable, verdict_of
from tests.control.rig_stage import shipped_config
from tests.experiment.made_up import record_of, write_record


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FileFit:
    """Return the fit of a good record."""
    path = tmp_path_factory.mktemp("verdict") / "data.csv"
    write_record(path, record_of())
    settings = FitSettings(order=6)
    return identify_file(path, test=None, skip_s=0.0, delay_s=0.0, settings=settings)


def test_good_model_is_usable(fitted: FileFit) -> None:
    """In five lines; the error is larger than that of the held-out blocks."""
    found = verdict_of(fitted, written=True)

    assert found.usable is Usable.YES
    assert len(found.lines) == 5
    assert found.position_rms_pct > fitted.chosen.validation.position_rms_pct


def test_doubts_and_questions_come_before_use(fitted: FileFit) -> None:
    """The first line has the first question."""
    doubtful = replace(fitted, warnings=("It drifts.",))
    asked = replace(doubtful, questions=("Is it in nm?",))

    assert verdict_of(doubtful, written=True).usable is Usable.WITH_DOUBTS
    assert verdict_of(asked, written=True).usable is Usable.ASK
    assert "Is it in nm?" in verdict_of(asked, written=True).lines[0]


def test_model_that_does_not_fit_its_axis_cannot_be_used(fitted: FileFit) -> None:
    """The configuration answers the questions; what it contradicts is in the first line."""
    config = shipped_config().axes["x"]
    sheet = config.model_copy(update={"expected_travel_um": 100.0})
    asked = replace(fitted, questions=("Is it in nm?",))

    assert verdict_of(asked.of_axis(config), written=True).usable is Usable.YES
    found = verdict_of(asked.of_axis(sheet), written=True)
    assert found.usable is Usable.NO
    assert "100 µm for 150 V" in found.lines[0]
