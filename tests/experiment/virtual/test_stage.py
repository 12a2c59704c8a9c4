"""Tests of the stage of an experiment: checks before anything moves, rest and zero."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod.experiment.virtual.stage import POSITION_UM, TRUE_UM, VirtualStage, opened
from piezod_drivers.simulated.driver import PLUGIN, SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.experiment.conftest import Load


def ignore(_further_s: float) -> None:
    """Ignore the progress."""


class Charged(Channels):
    """Channels of a stage that was left at 42 V."""

    def __init__(self) -> None:
        super().__init__({}, {})

    def read_back(self, now_ns: int) -> list[float]:
        del now_ns
        return [42.0]


class RigWithoutTruth:
    """A rig that does not know the truth, like a real one."""

    def __init__(self, options: SimulatedOptions, wiring: Wiring, seed: int) -> None:
        rig = SimulatedRig(options, wiring, seed)
        self.open, self.capabilities, self.close = rig.open, rig.capabilities, rig.close
        self.activate, self.deactivate = rig.activate, rig.deactivate
        self.read, self.write, self.read_back = rig.read, rig.write, rig.read_back


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the driver build rigs that do not know the truth."""
    plugin = replace(PLUGIN, create=RigWithoutTruth)
    monkeypatch.setattr(registry, "load", lambda _name: plugin)


def test_rate_above_that_of_the_devices_is_refused(load: Load, short: str) -> None:
    """The error names both rates, and the devices are closed."""
    fast = short.replace("rate_hz: 1000", "rate_hz: 20000")
    slow_device = load(fast).model_copy(update={"rate_hz": 50_000.0})
    with (
        pytest.raises(DeviceError, match="rate_hz is 50000 Hz; these devices allow at most 20000"),
        opened(slow_device, ignore),
    ):
        pass


@pytest.mark.usefixtures("blind")
def test_true_metrics_are_refused_without_a_known_truth(load: Load, short: str) -> None:
    """The error names metrics, device, axis and remedy, before anything moves."""
    asked = load(f"{short}metrics: [nonlinearity_pct, true_nonlinearity_pct, noise_rms_pct]\n")
    expected = (
        "metrics requests true_nonlinearity_pct, noise_rms_pct, but device rig, the sensor of axis "
        "x, does not know the true displacement, as simulated devices do; remove these"
    )
    with pytest.raises(DeviceError, match=f"^{expected}$"), opened(asked, ignore):
        pass


def test_voltage_in_force_is_read_and_not_assumed(load: Load, short: str) -> None:
    """A charged stage starts at its voltage."""
    config: ExperimentConfig = load(short)

    assert VirtualStage(Charged(), config, ignore).in_force_v == [42.0]


def test_short_rest_zeroes_the_sensor(load: Load, short: str) -> None:
    """The average is over the whole rest: here 0.1 s, on the way down from 75 V."""
    with opened(load(short), ignore) as stage:
        stage.open_loop([lambda _t_s: 75.0], 0.5)
        stage.rest(0.1)
        after = stage.open_loop([lambda _t_s: 0.0], 0.02)

    assert after[0, :, POSITION_UM].mean() < -1.0  # zero was taken while the stage was still up


def test_truth_is_zeroed_over_the_same_samples_as_the_sensor(load: Load, short: str) -> None:
    """After a rest both are zero; the truth has no noise and follows the drive."""
    with opened(load(short), ignore) as stage:
        stage.open_loop([lambda _t_s: 75.0], 0.5)
        stage.rest(1.0)
        still = stage.open_loop([lambda _t_s: 0.0], 0.2)[0]
        moved = stage.open_loop([lambda t_s: 75.0 * t_s], 1.0)[0]

    assert abs(still[:, TRUE_UM].mean()) < 0.01
    assert abs(still[:, POSITION_UM].mean()) < 0.01
    assert np.std(np.diff(still[:, TRUE_UM])) < 0.1 * np.std(np.diff(still[:, POSITION_UM]))
    assert moved[-1, TRUE_UM] > 5.0
    assert moved[:, TRUE_UM] == pytest.approx(moved[:, POSITION_UM], abs=0.2)


def test_truth_does_not_depend_on_the_sensor(load: Load, short: str) -> None:
    """The same drive gives the same motion for any sensor, up to its zero."""
    noise = "{variant: stack, effects: {sensor_noise: false}}"
    traces = []
    for text in (short, short.replace("{variant: stack}", noise)):
        with opened(load(text), ignore) as stage:
            traces.append(stage.open_loop([lambda t_s: 75.0 * t_s], 1.0)[0])
    noisy, quiet = traces

    assert np.array_equal(noisy[:, TRUE_UM], quiet[:, TRUE_UM])
    assert not np.array_equal(noisy[:, POSITION_UM], quiet[:, POSITION_UM])


@pytest.mark.usefixtures("blind")
def test_unknown_truth_is_nan(load: Load, short: str) -> None:
    """It stays NaN after a rest, and the sensor is zeroed anyway."""
    with opened(load(short), ignore) as stage:
        stage.rest(0.5)
        trace = stage.open_loop([lambda _t_s: 0.0], 0.2)[0]

    assert np.isnan(trace[:, TRUE_UM]).all()
    assert abs(trace[:, POSITION_UM].mean()) < 0.05
