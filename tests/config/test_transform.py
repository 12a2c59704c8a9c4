"""User axes in the configuration of a stage: each mistake is told with its number."""

import json
from pathlib import Path
from typing import Any

import pytest

from piezod.config.coupling_file import CouplingFile, dump_coupling, load_coupling
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.devices import registry
from piezod.errors import ConfigError

AXIS: dict[str, Any] = {
    "amplifier": "rig",
    "sensor": "rig",
    "limits": {"drive_min_v": 0, "drive_max_v": 150, "slew_v_per_s": 1000, "rest_v": 0},
    "command_range_um": [0, 20],
}


def load(folder: Path, stage_axes: dict[str, Any], **transform: Any) -> DaemonConfig:
    """Return a configuration with these axes and this transform."""
    document = {
        "rate_hz": 100,
        "devices": {"rig": {"driver": "simulated"}},
        "axes": stage_axes,
        "transform": transform,
    }
    path = folder / "stage.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")
    return load_daemon(path, registry)


def good(**changed: Any) -> dict[str, Any]:
    """Return a transform of two axes, with changes."""
    return {
        "axes": {"x": {"range": [1, 19]}, "y": {"range": [1, 19]}},
        "actuators": {"a": {"x": 1}, "b": {"y": 1}},
        **changed,
    }


TWO = {"a": AXIS, "b": AXIS}


def test_user_axes_follow_the_axes(tmp_path: Path) -> None:
    """Records have the axes first; each of them tells which user axes move it."""
    config = load(tmp_path, TWO, **good())
    assert config.shown_axes == ("a", "b", "x", "y")
    assert config.moved_by("a") == "x, y"
    assert config.moved_by("x") == ""
    assert config.transform is not None
    assert config.transform.contour_axes == ("x", "y")


@pytest.mark.parametrize(
    ("axes", "transform", "place", "number"),
    [
        pytest.param(
            {**TWO, "c": AXIS},
            good(actuators={"a": {"x": 1}, "b": {"y": 1}, "c": {"y": 1}}),
            "transform.actuators",
            "got 3 for 2",
            id="too many actuators",
        ),
        pytest.param(
            TWO, good(actuators={"a": {"x": 1}}), "transform.actuators", "got 1 for 2", id="too few"
        ),
        pytest.param(
            TWO,
            good(actuators={"a": {"x": 1}, "q": {"y": 1}}),
            "transform.actuators.q",
            "'q'",
            id="no such axis",
        ),
        pytest.param(
            TWO,
            good(actuators={"a": {"x": 1}, "b": {"z": 1}}),
            "transform.actuators.b.z",
            "'z'",
            id="no such user axis",
        ),
        pytest.param(
            TWO,
            good(actuators={"a": {"x": 1, "y": 1}, "b": {"x": 1, "y": 1}}),
            "transform.actuators",
            "inf times",
            id="singular",
        ),
        pytest.param(
            TWO,
            good(actuators={"a": {"x": 1, "y": 1}, "b": {"x": 1, "y": 1.001}}),
            "transform.actuators",
            "at most 100",
            id="badly conditioned",
        ),
        pytest.param(
            TWO,
            good(sensors={"x": {"a": 1}}),
            "transform.sensors",
            "got 1",
            id="a user axis without sensors",
        ),
        pytest.param(
            TWO,
            good(sensors={"x": {"a": 1}, "y": {"a": 1}}),
            "transform.sensors",
            "got 1",
            id="a sensor is missing",
        ),
        pytest.param(
            {"a": AXIS, "b": {key: AXIS[key] for key in AXIS if key != "sensor"}},
            good(),
            "transform.actuators.b",
            "needs 2 sensors (got 1)",
            id="an axis without a sensor",
        ),
        pytest.param(
            TWO,
            good(axes={"a": {"range": [1, 19]}, "y": {"range": [1, 19]}}),
            "transform.axes.a",
            "name",
            id="the name of an axis",
        ),
        pytest.param(
            TWO,
            good(axes={"x": {"range": [9, 1]}, "y": {"range": [1, 19]}}),
            "transform.axes.x.range[1]",
            "above the first",
            id="no range",
        ),
        pytest.param(
            TWO,
            good(axes={"x": {"range": [1, 19], "abbe_mm": {"y": 3}}, "y": {"range": [1, 9]}}),
            "transform.axes.x.abbe_mm.y",
            "µrad",
            id="a lever without an angle",
        ),
        pytest.param(
            TWO,
            good(coupling={"shares": {"a": {"q": 0.03}}}),
            "transform.coupling",
            "got q",
            id="the coupling of other axes",
        ),
        pytest.param(
            TWO,
            good(coupling={"shares": {"a": {"b": 0.6}}}),
            "transform.coupling.shares.a.b",
            "-0.5 to 0.5",
            id="more coupling than motion",
        ),
        pytest.param(
            TWO,
            good(coupling={"shares": {"a": {"b": 0.03}}, "lags_s": {"b": {"a": 0.01}}}),
            "transform.coupling.lags_s.b.a",
            "no share",
            id="the lag of nothing",
        ),
        pytest.param(
            {"a": {**AXIS, "command_input": {"device": "rig", "channel": "b"}}, "b": AXIS},
            good(),
            "axes.a.command_input",
            "x, y",
            id="a command input",
        ),
    ],
)
def test_a_mistake_is_told_with_its_number(
    tmp_path: Path, axes: dict[str, Any], transform: dict[str, Any], place: str, number: str
) -> None:
    """A transform that cannot work is refused where it is wrong, with the number that is wrong."""
    with pytest.raises(ConfigError) as error:
        load(tmp_path, axes, **transform)
    assert any(f"{place}:" in str(each) for each in error.value.problems), str(error.value)
    assert number in str(error.value)


def test_a_lever_and_an_offset_become_part_of_the_frame(tmp_path: Path) -> None:
    """10 mm beside the axis of rotation 100 µrad are 1 µm; an offset shifts the zero."""
    axes = {
        "x": {"range": [1, 19], "abbe_mm": {"r": 10}, "offset": 2},
        "r": {"range": [-200, 200], "unit": "µrad"},
    }
    config = load(tmp_path, TWO, **good(axes=axes, actuators={"a": {"x": 1}, "b": {"r": 0.1}}))
    assert config.transform is not None
    assert config.transform.frame().actuators([3.0, 100.0]) == pytest.approx([0.0, 10.0])
    assert config.unit("r") == "µrad"
    assert config.transform.contour_axes == ()


def test_a_coupling_file_comes_back(tmp_path: Path) -> None:
    """What a coupling file says can be read again, and takes the place of the mapping."""
    shares = {"a": {"b": 0.03}, "b": {"a": -0.02}}
    coupling = CouplingFile(shares=shares, lags_s={"b": {"a": 0.004}})
    path = tmp_path / "coupling.yaml"
    path.write_text(dump_coupling(coupling), encoding="utf-8")
    assert load_coupling(path) == coupling
    config = load(tmp_path, TWO, **good(coupling="coupling.yaml"))
    assert config.transform is not None
    assert config.transform.coupling == coupling
    assert config.transform.lags == ((), ((0, -0.02, 0.004),))
    shown_um = config.transform.frame().actuators([10.0, 0.0])
    assert shown_um[1] == pytest.approx(0.2, abs=1e-3)
