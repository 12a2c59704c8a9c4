"""Tests of fits to a measured stage, by their errors on other data."""

from pathlib import Path

import pytest

from piezod.experiment.fit.automatic import Wanted
from piezod.experiment.fit.errors import Judgement
from piezod.experiment.fit.file import FileFit, identify_file
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.settings import FitSettings
from tests.conftest import Figure

ALIGNED_S = 0.005
"""The displacement of this record is one sample late."""


def identified(shared_data: Path, settings: FitSettings | Wanted, skip_s: float) -> FileFit:
    """Fit the measured record, and judge it on the other one."""
    folder = shared_data / "data" / "ntu_p885"
    return identify_file(
        folder / "identification.csv",
        test=folder / "test.csv",
        skip_s=skip_s,
        delay_s=ALIGNED_S,
        settings=settings,
    )


def check_errors_on_other_data(judged: Judgement, name: str, figure: Figure) -> None:
    """Check the errors on held-out blocks and, without an offset, on test.csv; print them."""
    held_out, removed = judged.validation.errors, judged.test_offset_removed
    assert removed is not None
    figure(
        f"measured stage, {name}: held-out blocks {held_out['voltage_error_max_pct']:.2f} % worst, "
        f"{held_out['voltage_error_rms_pct']:.3f} % rms; test.csv without a constant offset of "
        f"{removed.offset_pct:.2f} %: {removed.errors['voltage_error_rms_pct']:.3f} % rms"
    )
    assert held_out["voltage_error_max_pct"] <= 1.3
    assert held_out["voltage_error_rms_pct"] <= 0.3
    assert removed.errors["voltage_error_rms_pct"] <= 1.05


@pytest.mark.parametrize("skip_s", [0.0, 1.0])
@pytest.mark.parametrize("creep", [False, True])
@pytest.mark.few(1)
def test_graded_models_hold_on_blocks_and_on_another_record(
    shared_data: Path, figure: Figure, skip_s: float, creep: bool
) -> None:
    """With and without creep, on held-out blocks and on test.csv, with its offset and without."""
    settings = FitSettings(spacing=Spacing.GRADED, creep=creep)
    name = f"{'with' if creep else 'without'} creep, first {skip_s:g} s left out"
    judged = identified(shared_data, settings, skip_s).chosen

    check_errors_on_other_data(judged, name, figure)
    assert judged.test is not None
    assert judged.test["voltage_error_rms_pct"] <= 2.05  # most of it is the offset
    assert judged.test["position_error_rms_pct"] <= 2.8


def test_surface_describes_a_record_that_starts_after_a_rest(
    shared_data: Path, figure: Figure
) -> None:
    """The creep of the rest before the record follows from its first position."""
    settings = FitSettings(method=Method.SURFACE, creep=True)
    fitted = identified(shared_data, settings, 1.0)

    errors, creep = fitted.chosen.validation.errors, fitted.chosen.fit.model.creep.per_decade
    figure(
        f"measured stage, surface: held-out voltage {errors['voltage_error_rms_pct']:.3f} % rms, "
        f"position {errors['position_error_rms_pct']:.3f} % rms, creep {100 * creep:.1f} % a decade"
    )
    assert errors["voltage_error_rms_pct"] <= 0.35
    assert errors["position_error_rms_pct"] <= 0.35
    assert 0.005 < creep < 0.05
    assert any("does not have loops of all sizes" in warning for warning in fitted.warnings)


def test_stops_with_creep_predict_the_position_of_held_out_blocks(
    shared_data: Path, figure: Figure
) -> None:
    """A range that is fitted to the voltage alone gives 0.6 % rms."""
    settings = FitSettings(order=30, spacing=Spacing.GRADED, creep=True)
    errors = identified(shared_data, settings, 1.0).chosen.validation.errors

    figure(
        f"measured stage, stops: held-out position {errors['position_error_max_pct']:.2f} % worst, "
        f"{errors['position_error_rms_pct']:.3f} % rms"
    )
    assert errors["position_error_max_pct"] <= 0.9
    assert errors["position_error_rms_pct"] <= 0.3


@pytest.mark.stress
def test_automatic_choice_holds_on_blocks_and_on_another_record(
    shared_data: Path, figure: Figure
) -> None:
    """The chosen model predicts held-out blocks and the other record, voltage and position."""
    judged = identified(shared_data, Wanted(), 1.0).chosen
    held_out, removed = judged.validation.errors, judged.test_offset_removed
    assert removed is not None

    check_errors_on_other_data(judged, "chosen automatically", figure)
    figure(
        f"measured stage, position: held-out {held_out['position_error_max_pct']:.2f} % worst, "
        f"{held_out['position_error_rms_pct']:.3f} % rms; test.csv without a constant offset "
        f"{removed.errors['position_error_rms_pct']:.3f} % rms"
    )
    assert held_out["voltage_error_max_pct"] <= 0.65
    assert held_out["voltage_error_rms_pct"] <= 0.125
    assert held_out["position_error_max_pct"] <= 0.85
    assert held_out["position_error_rms_pct"] <= 0.26
    assert removed.errors["voltage_error_rms_pct"] <= 0.79
    assert removed.errors["position_error_rms_pct"] <= 1.06
