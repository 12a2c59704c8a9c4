"""Coupled axes of the simulated rig."""

from typing import Any

import numpy as np
import pytest

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

MS = 1_000_000


def opened(coupling: dict[str, Any], *inputs: str, **more: float) -> SimulatedRig:
    """Return an open rig of two axes."""
    options = SimulatedOptions.model_validate({"coupling": coupling, **more})
    rig = SimulatedRig(options, Wiring(inputs or ("x", "y"), ("x", "y")), 1)
    rig.open()
    rig.activate(0)
    return rig


def test_an_axis_moves_the_other_one() -> None:
    """At 3 %, y shows 3 % of the way of x, in truth and by its sensor; x shows nothing of y."""
    rig = opened({"y": {"x": 0.03}})
    rig.write([100.0, 0.0], MS)
    samples = rig.read(200 * MS)
    true_um = rig.true_position_um(200 * MS)
    assert true_um[1] == pytest.approx(0.03 * true_um[0], abs=0.01)
    assert samples[1].position_um == pytest.approx(true_um[1], abs=0.05)
    rig.write([0.0, 0.0], 201 * MS)


def test_an_axis_may_move_the_other_one_later() -> None:
    """Of a steady motion y shows what x did a time constant ago, in truth and by its sensor."""
    rig = opened({"y": {"x": 0.1}}, coupling_lag_s=0.02)
    seen = []
    for k in range(1, 401):
        rig.write([0.25 * k, 0.0], k * MS)
        samples = rig.read(k * MS)
        seen.append((*rig.true_position_um(k * MS), samples[1].position_um))
    x_um, y_um, shown_um = np.array(seen).T
    assert y_um[-1] == pytest.approx(0.1 * x_um[-21], abs=0.003)
    assert shown_um[-100:].mean() == pytest.approx(y_um[-100:].mean(), abs=0.03)
    for k in range(401, 1001):
        rig.read(k * MS)
    x_um, y_um = rig.true_position_um(1000 * MS)
    assert y_um == pytest.approx(0.1 * x_um, abs=1e-3)


def test_axes_are_not_coupled_by_default() -> None:
    """Without the option each axis moves alone."""
    rig = opened({})
    rig.write([100.0, 0.0], MS)
    rig.read(200 * MS)
    assert rig.true_position_um(200 * MS)[1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("coupling", "inputs", "what"),
    [
        ({"q": {"x": 0.03}}, (), "no axis q"),
        ({"x": {"q": 0.03}}, (), "no axis q"),
        ({"y": {"x": 0.03}}, ("x", "y_v"), "calibrated"),
    ],
)
def test_a_coupling_that_cannot_be_shown_is_refused(
    coupling: dict[str, Any], inputs: tuple[str, ...], what: str
) -> None:
    """A coupling names axes of the rig, and needs calibrated sensors."""
    with pytest.raises(DeviceError, match=what):
        opened(coupling, *inputs)


def test_a_coupled_rig_plays_no_tables() -> None:
    """Its record would show each axis by itself."""
    with pytest.raises(DeviceError, match="coupled"):
        opened({"y": {"x": 0.03}}).player_capabilities()
