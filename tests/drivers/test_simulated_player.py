"""The player of the simulated rig."""

import numpy as np
import pytest

from piezod.devices.interface import Wiring
from piezod.devices.player import KnowsTruePlay, PlayState, Table
from piezod.errors import DeviceError
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

INTERVAL_NS = 50_000
WIRING = Wiring(("x", "x_v", "y"), ("x", "y"))


def opened(sub_step_us: int = 50) -> SimulatedRig:
    """Return an active rig with two driven axes and three inputs."""
    options = SimulatedOptions.model_validate({"sub_step_us": sub_step_us})
    rig = SimulatedRig(options, WIRING, 3)
    rig.open()
    rig.activate(0)
    return rig


def waves(points: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return a wave for each axis, in V."""
    turns = np.arange(points)[:, None] / points
    return 60.0 + np.array([50.0, -30.0]) * np.sin(2.0 * np.pi * turns)


def test_a_play_is_the_same_as_single_writes() -> None:
    """Writing each point at its instant gives the same samples and truths, to the bit."""
    played, written = opened(), opened()
    table = Table(INTERVAL_NS, waves(30)[:10], waves(40), 2)
    loaded = played.load(table)
    played.arm()
    played.start(0)
    end_ns = table.duration_ns
    assert played.progress(end_ns).state is PlayState.ENDED
    points = np.concatenate((loaded.lead_in, loaded.period, loaded.period))
    samples, truths = [], []
    for k, values in enumerate(points):
        samples.append([sample.position_um for sample in written.read(k * INTERVAL_NS)])
        truths.append(written.true_position_um(k * INTERVAL_NS))
        assert written.write(values.tolist(), k * INTERVAL_NS)

    assert isinstance(played, KnowsTruePlay)
    assert np.array_equal(played.recording().positions, samples)
    assert np.array_equal(played.true_recording(), truths)
    assert played.read(end_ns) == written.read(end_ns)


def test_calls_during_a_play_do_not_change_it() -> None:
    """Reading and reading back at any instant leave the record as it is."""
    quiet, busy = opened(), opened()
    table = Table(INTERVAL_NS, waves(30)[:10], waves(40), 5)
    for rig in (quiet, busy):
        rig.load(table)
        rig.arm()
        rig.start(12_345)
    rng = np.random.default_rng(1)
    for t_ns in np.sort(rng.integers(12_345, table.duration_ns, 50)).tolist():
        busy.read(t_ns)
        busy.read_back(t_ns)
        busy.true_position_um(t_ns)
    for rig in (quiet, busy):
        assert rig.progress(table.duration_ns + 2 * INTERVAL_NS).state is PlayState.ENDED

    assert np.array_equal(quiet.recording().positions, busy.recording().positions)


def test_replaced_period_begins_with_the_next_cycle() -> None:
    """The cycle in play is finished first."""
    rig = opened()
    before, after = np.full((20, 2), 10.0), np.full((20, 2), 12.0)
    table = Table(INTERVAL_NS, np.empty((0, 2)), before, 4)
    rig.load(table)
    rig.arm()
    rig.start(0)
    rig.progress(30 * INTERVAL_NS)
    rig.replace(after)
    drive_v = []
    for k in range(31, 80):
        drive_v.append(rig.read_back(k * INTERVAL_NS + INTERVAL_NS // 2)[0])

    assert drive_v[39 - 31] == pytest.approx(10.0, abs=0.1)  # the last point of the cycle
    assert drive_v[-1] == pytest.approx(12.0, abs=0.1)
    with pytest.raises(DeviceError, match="same number of points"):
        rig.replace(after[:5])


def test_short_steps_of_the_physics_allow_fast_tables() -> None:
    """With a step of 10 µs, 100000 points a second are played; with one of 50 µs, 20000."""
    fast, slow = opened(10), opened(50)
    table = Table(10_000, np.empty((0, 2)), waves(100), 10)
    fast.load(table)
    fast.arm()
    fast.start(0)
    assert fast.progress(table.duration_ns).state is PlayState.ENDED
    assert len(fast.recording().positions) == 1000

    with pytest.raises(DeviceError, match="50000 ns"):
        slow.load(table)


def test_rest_of_the_physics_does_not_depend_on_its_step() -> None:
    """The true motion of a table is the same to 0.1 % with steps of 50 and of 10 µs."""
    truths = []
    for sub_step_us in (50, 10):
        rig = opened(sub_step_us)
        table = Table(INTERVAL_NS, np.empty((0, 2)), waves(200), 2)
        rig.load(table)
        rig.arm()
        rig.start(0)
        rig.progress(table.duration_ns)
        truths.append(rig.true_recording()[:, 0])

    assert np.max(np.abs(truths[0] - truths[1])) < 1e-3 * np.ptp(truths[1])


def test_invalid_sample_is_nan_in_the_record() -> None:
    """A saturated sensor gives no displacement; the truth is known all the same."""
    options = SimulatedOptions.model_validate({"sensor": {"saturation_v": 2.0}})
    rig = SimulatedRig(options, Wiring.both(("x",)), 3)
    rig.open()
    rig.activate(0)
    table = Table(INTERVAL_NS, np.linspace(0.0, 140.0, 2000)[:, None], np.full((10, 1), 140.0), 1)
    rig.load(table)
    rig.arm()
    rig.start(0)
    rig.progress(table.duration_ns)

    positions = rig.recording().positions[:, 0]
    assert np.isfinite(positions[0])
    assert np.isnan(positions[-1])
    assert np.isfinite(rig.true_recording()).all()
