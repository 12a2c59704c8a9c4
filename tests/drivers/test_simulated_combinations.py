"""The simulated rig with any allowed options works or gives a reason why it does not."""

from itertools import combinations, product
from math import isfinite
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod.plant.effects import EFFECTS
from piezod.plant.parameters import (
    AmplifierParameters,
    SensorParameters,
    StageParameters,
    quantities,
)
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.driver import PLUGIN, SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

MS: Final = 1_000_000
PARTS: Final[dict[str, type[Any]]] = {
    "stage": StageParameters,
    "amplifier": AmplifierParameters,
    "sensor": SensorParameters,
}
EDGES: Final = [
    (part, name, edge)
    for part, parameters in PARTS.items()
    for name, quantity in quantities(parameters).items()
    for edge in (quantity.low, quantity.high)
]
CALIBRATIONS: Final = (
    None,
    {"kind": "line"},
    {"kind": "commissioned", "residual_pct": 5},
    {"kind": "table", "sensor_v": (5.0, 0.0), "position_um": (-1e5, 1e5)},
)


def use(keys: dict[str, Any], *, drive_v: float = 10.0, seed: int = 1) -> bool:
    """Use a rig from opening to closing, and return whether that was possible.

    Anything but a broken rule of the options or a `DeviceError` fails the test, and so do a warning
    and a position that is not a number.
    """
    try:
        rig = PLUGIN.create(SimulatedOptions.model_validate(keys), Wiring.both("x"), seed)
        assert isinstance(rig, SimulatedRig)
        rig.open()
    except (ValidationError, DeviceError):
        return False
    rig.activate(0)
    positions_um = []
    for k in range(1, 6):
        rig.write([drive_v * k], k * MS)
        positions_um.append(rig.read((k + 1) * MS)[0].position_um)
        assert isfinite(rig.read_back((k + 1) * MS)[0])
    rig.deactivate(10 * MS)
    rig.close()
    assert all(map(isfinite, positions_um))
    return True


def keys_of(*edges: tuple[str, str, float]) -> dict[str, Any]:
    """Return parameters as options."""
    keys: dict[str, Any] = {part: {} for part in PARTS}
    for part, name, value in edges:
        keys[part][name] = value
    return keys


def test_each_bound_alone_works_or_is_refused() -> None:
    """A parameter at a bound gives a working rig, except for those listed here."""
    refused = [edge for edge in EDGES if not use(keys_of(edge))]

    assert refused == [
        ("stage", "reversible_um", 1000),
        ("stage", "irreversible_um", 1000),
        ("sensor", "slope_v_per_um", 1000),
        ("sensor", "light_level", 0),
        ("sensor", "light_level", 10),
        ("sensor", "setback_um", 1e4),
        ("sensor", "saturation_v", 0.1),
    ]


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.few(8)
def test_bounds_of_a_class_of_hysteresis_work(variant: str) -> None:
    """All combinations of the bounds of its parameters give a working rig."""
    law = quantities(type(VARIANTS[variant].parameters.hysteresis))
    for values in product(*((q.low, q.high) for q in law.values())):
        keys = {"variant": variant, "hysteresis": dict(zip(law, values, strict=True))}

        assert use(keys), values


@given(
    pair=st.sampled_from(list(combinations(EDGES, 2))), calibration=st.sampled_from(CALIBRATIONS)
)
def test_two_bounds_together_work_or_are_refused(
    pair: tuple[tuple[str, str, float], tuple[str, str, float]], calibration: Any
) -> None:
    """Each pair of bounds works or is refused with a reason."""
    use({**keys_of(*pair), "calibration": calibration})


@pytest.mark.stress
def test_every_pair_of_bounds_works_or_is_refused() -> None:
    """All pairs of bounds work or are refused; over a hundred are refused, most work."""
    pairs = list(combinations(EDGES, 2))
    working = sum(use(keys_of(*pair)) for pair in pairs)

    assert len(pairs) / 2 < working < len(pairs)


def _part(parameters: type[Any]) -> st.SearchStrategy[dict[str, float]]:
    return st.fixed_dictionaries(
        {},
        optional={
            # A subnormal number is a rounded 0, by which a sensor of no light at all is scaled.
            name: st.sampled_from([q.low, q.high]) | st.floats(q.low, q.high, allow_subnormal=False)
            for name, q in quantities(parameters).items()
        },
    )


OPTIONS: Final = st.fixed_dictionaries(
    {"variant": st.sampled_from(list(VARIANTS)), "calibration": st.sampled_from(CALIBRATIONS)},
    optional={
        "effects": st.dictionaries(st.sampled_from(EFFECTS), st.booleans()),
        **{part: _part(parameters) for part, parameters in PARTS.items()},
    },
)


@given(keys=OPTIONS, drive_v=st.floats(-300, 300), seed=st.integers(0, 2**32 - 1))
def test_any_options_work_or_are_refused(keys: dict[str, Any], drive_v: float, seed: int) -> None:
    """A rig with any options works, or opening it gives a reason."""
    use(keys, drive_v=drive_v, seed=seed)
