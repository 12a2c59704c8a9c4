"""The first mode in text and document of `piezod identify`, beside the configured one."""

import re
from pathlib import Path

import pytest

from piezod.cli.identify.document import as_document
from piezod.cli.identify.dynamics_view import mode_line
from piezod.cli.identify.run import record_and_fit
from piezod.config.first_mode import FirstModeConfig
from piezod.experiment.fit.file import FileFit, identify_file
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.live.identify import LiveRecord
from tests.control.rig_stage import shipped_config
from tests.experiment.fit.made_up_ringing import MODE, ringing_record
from tests.experiment.live_fakes import FakeStage
from tests.experiment.made_up import write_record


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FileFit:
    """Return the fit to a file with a record that rings."""
    file = tmp_path_factory.mktemp("data") / "ringing.csv"
    write_record(file, ringing_record(duration_s=1.0))
    settings = FitSettings(method=Method.SURFACE)
    return identify_file(file, test=None, skip_s=0.0, delay_s=0.00135, settings=settings)


def test_text_has_the_mode_and_the_reason(fitted: FileFit) -> None:
    """Frequency and damping with their uncertainty, and the errors with the mode and without."""
    assert re.fullmatch(
        r"First mode at (179\.\d+|180(\.\d+)?) ± [\d.e-]+ Hz with a damping ratio of 0\.0\d+ ± "
        r"[\d.e-]+ \(95 %\)\. It is part of the model, because the fit predicts held-out "
        r"positions to 0\.\d+ % rms with it, and to \d\S* % without it\. "
        r"For the axis: `first_mode: \{frequency_hz: 1\d\d(\.\d+)?, damping: 0\.0\d+\}`\.",
        mode_line(fitted),
    )


def test_fit_that_is_unsmoothed_is_its_own_counterpart(fitted: FileFit) -> None:
    """A model with a mode is fitted to the displacement as recorded, and not a second time."""
    assert fitted.raw is not None
    assert fitted.raw.fit is fitted.chosen.fit


def test_document_has_the_mode(fitted: FileFit) -> None:
    """The mode has its half widths, and its gain on held-out blocks."""
    mode = as_document(fitted, None, None)["first_mode"]

    assert isinstance(mode, dict)
    assert mode["frequency_hz"] == pytest.approx(MODE.frequency_hz, abs=2 * mode["frequency_hz_95"])
    assert mode["damping"] == pytest.approx(MODE.damping, abs=2 * mode["damping_95"])
    without_pct = mode["held_out_position_error_rms_without_mode_pct"]
    assert mode["held_out_position_error_rms_pct"] < 0.1 * without_pct
    assert mode["configured"] is None


def test_running_stage_has_its_configured_mode_beside_the_found_one(
    fitted: FileFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop uses the configuration: the fit of its record tells that it is wrong."""
    configured = FirstModeConfig(frequency_hz=90, damping=0.03)
    axis = shipped_config().axes["x"].model_copy(update={"first_mode": configured})
    recorded = LiveRecord("x", Path("ringing.csv"), 0.0, ("A warning.",), axis)
    monkeypatch.setattr("piezod.cli.identify.run.record_live", lambda *_, **__: recorded)

    beside, _ = record_and_fit(FakeStage(), lambda *_: fitted, None, None, None)

    first, second = beside.warnings[-2:]
    assert first == "A warning."
    assert "`first_mode` of the configuration, which the loop uses, has 90 Hz and 0.03." in second
    assert mode_line(beside).endswith("The configuration has 90 Hz and 0.03.")
    mode = as_document(beside, None, None)["first_mode"]
    assert isinstance(mode, dict)
    assert mode["configured"] == {"frequency_hz": 90.0, "damping": 0.03}
