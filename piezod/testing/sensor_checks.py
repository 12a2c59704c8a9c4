"""Driver contract: the checks of sensors."""

import math
from collections.abc import Callable
from typing import Final, TypeAlias

from piezod.devices.interface import Sensor
from piezod.testing.check_support import T0_NS, active, assert_refused

SensorFactory: TypeAlias = Callable[[], Sensor]

_PERIOD_NS: Final = 1_000_000
_CYCLES: Final = 20


def reading_needs_an_active_sensor(factory: SensorFactory) -> None:
    """Reading is refused before activation and after deactivation."""
    sensor = factory()
    assert_refused("read before open", lambda: sensor.read(T0_NS))
    try:
        sensor.open()
        assert_refused("read before activate", lambda: sensor.read(T0_NS))
        sensor.activate(T0_NS)
        sensor.deactivate(T0_NS)
        assert_refused("read after deactivate", lambda: sensor.read(T0_NS))
    finally:
        sensor.close()
    assert_refused("read after close", lambda: sensor.read(T0_NS))


def every_axis_gives_one_sample(factory: SensorFactory) -> None:
    """A read returns one sample per axis, and a valid sample is finite."""
    with active(factory) as sensor:
        n_axes = len(sensor.capabilities().inputs)
        for cycle in range(1, _CYCLES):
            samples = sensor.read(T0_NS + cycle * _PERIOD_NS)

            assert len(samples) == n_axes, f"{len(samples)} samples of {n_axes} axes"
            for sample in samples:
                assert math.isfinite(sample.position_um) or not sample.valid, f"valid: {sample}"


def samples_carry_their_time(factory: SensorFactory) -> None:
    """A sample is no later than the call that read it, and no earlier than the sample before."""
    with active(factory) as sensor:
        previous_ns = [0] * len(sensor.capabilities().inputs)
        for cycle in range(1, _CYCLES):
            now_ns = T0_NS + cycle * _PERIOD_NS
            taken_ns = [sample.t_ns for sample in sensor.read(now_ns)]

            assert all(t_ns <= now_ns for t_ns in taken_ns), f"{taken_ns} read at {now_ns}"
            assert all(map(int.__ge__, taken_ns, previous_ns)), f"{taken_ns} after {previous_ns}"
            previous_ns = taken_ns


SENSOR_CHECKS: Final = (
    reading_needs_an_active_sensor,
    every_axis_gives_one_sample,
    samples_carry_their_time,
)
