"""Driver contract: the checks of sensors that know the true displacement."""

import math
from collections.abc import Callable
from typing import Final, Protocol, TypeAlias

from piezod.devices.interface import KnowsTruth, Sample, Sensor
from piezod.testing.check_support import T0_NS, active, assert_refused

_PERIOD_NS: Final = 1_000_000
_CYCLES: Final = 20


class KnowingSensor(Sensor, KnowsTruth, Protocol):
    """A sensor that knows the true displacement."""


KnowingSensorFactory: TypeAlias = Callable[[], KnowingSensor]


def truth_needs_an_active_sensor(factory: KnowingSensorFactory) -> None:
    """The true displacement is available only while the device is active."""
    sensor = factory()
    assert_refused("true_position_um before open", lambda: sensor.true_position_um(T0_NS))
    with active(lambda: sensor):
        sensor.true_position_um(T0_NS)
        sensor.deactivate(T0_NS)
        assert_refused("true_position_um while inactive", lambda: sensor.true_position_um(T0_NS))
    assert_refused("true_position_um after close", lambda: sensor.true_position_um(T0_NS))


def every_axis_has_one_truth(factory: KnowingSensorFactory) -> None:
    """There is one finite number per axis."""
    with active(factory) as sensor:
        n_axes = len(sensor.capabilities().inputs)
        for cycle in range(1, _CYCLES):
            sensor.read(T0_NS + cycle * _PERIOD_NS)
            true_um = sensor.true_position_um(T0_NS + cycle * _PERIOD_NS)

            assert len(true_um) == n_axes, f"{len(true_um)} true displacements of {n_axes} axes"
            assert all(map(math.isfinite, true_um)), f"not finite: {true_um}"


def asking_for_the_truth_changes_nothing(factory: KnowingSensorFactory) -> None:
    """Two equal devices give the same samples if only one is asked for the truth."""
    asked, left_alone = _samples(factory, asking=True), _samples(factory, asking=False)

    assert asked == left_alone, f"asked {asked}, left alone {left_alone}"


def _samples(factory: KnowingSensorFactory, *, asking: bool) -> list[list[Sample]]:
    taken = []
    with active(factory) as sensor:
        for cycle in range(1, _CYCLES):
            now_ns = T0_NS + cycle * _PERIOD_NS
            taken.append(list(sensor.read(now_ns)))
            if asking:
                sensor.true_position_um(now_ns)
    return taken


TRUTH_CHECKS: Final = (
    truth_needs_an_active_sensor,
    every_axis_has_one_truth,
    asking_for_the_truth_changes_nothing,
)
