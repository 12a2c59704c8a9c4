"""The stage of an experiment: what is checked and known before anything moves."""

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.devices.channels import Channels
from piezod.errors import DeviceError
from piezod.experiment.stage import POSITION_UM, Stage, opened
from tests.experiment.conftest import Load


def nothing(_cycles: int) -> None:
    """Let progress go by."""


class Charged(Channels):
    """Channels of a stage that somebody left at 42 V."""

    def __init__(self) -> None:
        super().__init__({}, {})

    def read_back(self, now_ns: int) -> list[float]:
        del now_ns
        return [42.0]


def test_a_rate_above_that_of_the_devices_is_refused(load: Load, short: str) -> None:
    """The error names both rates, and the devices are closed."""
    fast = short.replace("rate_hz: 1000", "rate_hz: 20000")
    slow_device = load(fast).model_copy(update={"rate_hz": 50_000.0})
    with (
        pytest.raises(DeviceError, match="rate_hz is 50000 Hz; these devices allow at most 20000"),
        opened(slow_device, nothing),
    ):
        pass


def test_the_voltage_in_force_is_read_and_not_assumed(load: Load, short: str) -> None:
    """A stage that was left charged starts from where it is."""
    config: ExperimentConfig = load(short)

    assert Stage(Charged(), config, nothing).in_force_v == [42.0]


def test_a_short_rest_zeroes_the_sensor_too(load: Load, short: str) -> None:
    """What there is of a rest is averaged: here 0.1 s, on the way down from 75 V."""
    with opened(load(short), nothing) as stage:
        stage.open_loop([lambda _t_s: 75.0], 0.5)
        stage.rest(0.1)
        after = stage.open_loop([lambda _t_s: 0.0], 0.02)

    assert after[0, :, POSITION_UM].mean() < -1.0  # zero was taken while the stage was still up
