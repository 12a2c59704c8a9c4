"""The results as a configuration and as a sheet."""

from math import nan
from pathlib import Path

import numpy as np
import pytest
import yaml

from piezod.commission.noise import Noise
from piezod.commission.procedure import Findings
from piezod.commission.profile import profile
from piezod.commission.response import Response
from piezod.commission.ringing import Ringing
from piezod.commission.session_trace import SessionTrace
from piezod.commission.sheet import Sheet, write_sheet
from piezod.commission.travel import Travel
from piezod.config.axes import CompensatorConfig
from piezod.config.daemon import DaemonConfig, SafetyConfig, load_daemon
from piezod.control.law.compensated import check_identifier
from piezod.devices import registry
from piezod.devices.interface import Identity
from piezod.hysteresis import StopForm, graded_thresholds, new_bank
from tests.commission.axes import configured

WHO = {"rig": Identity("maker", "model", "serial", "firmware")}
FOUND = Findings(
    noise=Noise(0.02, 0.0, 100.0, 0.0),
    travel=Travel(0.0, 140.0, 30.0, 0.21, 15.0, 0.07),
    response=Response(3e-4, 1e-5, np.array([1.0, 2.0]), np.array([4.0, 5.0])),
    ringing=Ringing(700.0, 0.03, 3000.0),
)


def written(
    tmp_path: Path, findings: Findings, config: DaemonConfig | None = None
) -> dict[str, object]:
    """Write a profile; return its axis after loading it as a configuration."""
    path = tmp_path / "stage.yaml"
    text = profile(config or configured(), "x", findings, WHO, "2026-01-01")
    path.write_text(text, encoding="utf-8")
    load_daemon(path, registry)
    axis: dict[str, object] = yaml.safe_load(text)["axes"]["x"]
    return axis


def test_a_profile_is_a_configuration_with_what_was_found(tmp_path: Path) -> None:
    """The limits are the driven voltages, and the commands cover nine tenths of the travel."""
    axis = written(tmp_path, FOUND)

    assert axis["command_range_um"] == [0.0, 27.0]
    assert axis["first_mode"] == {"frequency_hz": 700.0, "damping": 0.03}
    assert axis["limits"] == {
        "drive_min_v": 0.0,
        "drive_max_v": 140.0,
        "slew_v_per_s": 20_000.0,
        "rest_v": 0.0,
    }
    assert axis["compensator"]["delay_s"] == 0.0003  # type: ignore[index] # a mapping
    assert "model" not in axis


def test_a_profile_can_adopt_any_model_that_identify_makes(tmp_path: Path) -> None:
    """`piezod identify` gives graded thresholds by default, and LMS would diverge with them."""
    one = configured().axes["x"].model_copy(update={"compensator": CompensatorConfig()})
    written(tmp_path, FOUND, configured().model_copy(update={"axes": {"x": one}}))
    axis = load_daemon(tmp_path / "stage.yaml", registry).axes["x"]
    thresholds = graded_thresholds(19)

    assert axis.compensator.delay_s == 0.0003
    check_identifier(axis, StopForm(new_bank(thresholds, thresholds)))


def test_a_slow_stage_is_not_to_be_driven_fast(tmp_path: Path) -> None:
    """The slew rate is that of a full swing at a tenth of the first mode."""
    found = Findings(**{**vars(FOUND), "ringing": Ringing(50.0, 0.03, 3000.0)})

    assert written(tmp_path, found)["limits"]["slew_v_per_s"] == 2200.0  # type: ignore[index] # a mapping


def test_a_sensor_that_falls_is_turned_over(tmp_path: Path) -> None:
    """Its calibration gets the opposite sign, so that the position rises with the drive."""
    found = Findings(**{**vars(FOUND), "travel": Travel(0.0, 140.0, -30.0, -0.21, 15.0, 0.07)})
    axis = written(tmp_path, found)

    assert axis["command_range_um"] == [0.0, 27.0]
    assert axis["sensor"]["calibration"]["gain"] == -1.0  # type: ignore[index] # a mapping


def test_an_axis_that_was_driven_down_is_not_reversed(tmp_path: Path) -> None:
    """Drive and position both fell: the position rises with the drive."""
    found = Findings(**{**vars(FOUND), "travel": Travel(0.0, 100.0, -30.0, 0.3, 15.0, 0.07)})
    axis = written(tmp_path, found)

    assert axis["command_range_um"] == [0.0, 27.0]
    assert "calibration" not in axis["sensor"]  # type: ignore[operator] # a mapping


@pytest.mark.parametrize(("travel_um", "found_v"), [(30.0, "60.0 V"), (-30.0, "130.0 V")])
def test_an_axis_found_in_the_middle_gets_narrower_limits(
    travel_um: float, found_v: str, tmp_path: Path
) -> None:
    """A comment states it; rest voltage and safe voltage are within the limits."""
    found = Findings(**{**vars(FOUND), "travel": Travel(60.0, 130.0, travel_um, 0.3, 15.0, 0.07)})
    axis = written(tmp_path, found)

    assert axis["limits"]["drive_min_v"] == axis["limits"]["rest_v"] == 60.0  # type: ignore[index] # a mapping
    assert axis["safety"]["safe_v"] == 60.0  # type: ignore[index] # likewise
    text = (tmp_path / "stage.yaml").read_text(encoding="utf-8")
    assert "LIMITS ARE NARROWER than 0 to 150 V: only 60.0 to 130.0 V were driven," in text
    assert f"\n# because the axis was found at {found_v}." in text


def test_limits_that_noise_has_narrowed_are_no_news(tmp_path: Path) -> None:
    """A read-back of 0 V is never exactly 0 V, so small differences give no comment."""
    found = Findings(**{**vars(FOUND), "travel": Travel(0.1, 150.0, 30.0, 0.2, 15.0, 0.07)})
    written(tmp_path, found)

    assert "NARROWER" not in (tmp_path / "stage.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("safety", [{}, {"ramp_v_per_s": 100.0}])
def test_a_stage_that_is_slow_is_ramped_slowly(safety: dict[str, float], tmp_path: Path) -> None:
    """The ramp is no faster than the slew rate, with and without a configured ramp."""
    config = configured()
    one = config.axes["x"].model_copy(update={"safety": SafetyConfig.model_validate(safety)})
    config = config.model_copy(update={"axes": {"x": one}, "rate_hz": 10.0})
    found = Findings(**{**vars(FOUND), "travel": Travel(0.0, 10.0, 30.0, 3.0, 15.0, 0.07)})
    axis = written(tmp_path, found, config)

    assert axis["limits"]["slew_v_per_s"] == axis["safety"]["ramp_v_per_s"] == 31.0  # type: ignore[index] # mappings


def test_a_stage_without_a_mode_has_none(tmp_path: Path) -> None:
    """The configured mode stays: it may be from a data sheet."""
    found = Findings(**{**vars(FOUND), "ringing": Ringing(nan, nan, 600.0)})

    assert written(tmp_path, found)["first_mode"] == {"frequency_hz": 734.0, "damping": 0.03}


def test_a_sheet_lists_the_steps_not_done(tmp_path: Path) -> None:
    """A page is written even if steps are missing, with the available data beside it."""
    t_s = np.linspace(0.0, 1.0, 11)
    traces = {"noise": SessionTrace(t_s, 0 * t_s, 0 * t_s, np.sin(t_s))}
    found = Findings(noise=FOUND.noise, traces=traces)
    sheet = Sheet("x", {"rate": "1000 Hz"}, WHO, found, ["polarity", "delay"], "stage.yaml", "")
    text = write_sheet(tmp_path, sheet).read_text(encoding="utf-8")

    assert "Not done: polarity, delay." in text
    assert "20.00" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["acceptance.html", "noise.csv"]


@pytest.mark.parametrize("part", WHO["rig"])
def test_a_sheet_lists_the_identities_of_the_devices(tmp_path: Path, part: str) -> None:
    """It has maker, model, serial number and firmware."""
    sheet = Sheet("x", {}, WHO, Findings(), [], "stage.yaml", "")

    assert part in write_sheet(tmp_path, sheet).read_text(encoding="utf-8")
