"""A rig in another process, and its driver, when the other end goes away."""

import math
from pathlib import Path

import pytest

from piezod.devices.interface import Amplifier, Sensor
from piezod.devices.status import NO_FLAGS, DeviceFlag, TellsStatus
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.emulated.driver import EmulatedRig
from tests.drivers.emulated_bench import MS, T0_NS, driver_of, serving


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of the rig's socket."""
    return tmp_path / "rig.sock"


def active(path: Path) -> EmulatedRig:
    """Open and activate a driver."""
    driver = driver_of(path)
    driver.open()
    driver.activate(T0_NS)
    return driver


def test_driver_is_sensor_and_amplifier(path: Path) -> None:
    """One device is sensor and amplifier, and has a status."""
    driver = driver_of(path)

    assert isinstance(driver, Sensor)
    assert isinstance(driver, Amplifier)
    assert isinstance(driver, TellsStatus)


def test_driven_stage_moves(path: Path) -> None:
    """A written voltage moves the stage and is read back."""
    with serving(path):
        driver = active(path)
        assert driver.write([50.0], T0_NS)
        (sample,) = driver.read(T0_NS + 100 * MS)
        (in_force_v,) = driver.read_back(T0_NS + 100 * MS)
        driver.close()

    assert sample.valid
    assert sample.position_um > 5
    assert in_force_v == pytest.approx(50, abs=1)


def test_voltage_outlives_its_driver(path: Path) -> None:
    """A written voltage stays in force after its driver was closed."""
    with serving(path):
        first = active(path)
        assert first.write([50.0], T0_NS)
        first.close()
        second = active(path)
        (in_force_v,) = second.read_back(T0_NS + 100 * MS)
        second.close()

    assert in_force_v == pytest.approx(50, abs=1)


def test_rig_serves_one_at_a_time(path: Path) -> None:
    """A second driver is refused with the process that uses the rig."""
    with serving(path):
        first = active(path)
        with pytest.raises(DeviceUnavailableError, match="used by process"):
            driver_of(path).open()
        first.close()


def test_rig_is_free_when_its_driver_has_gone(path: Path) -> None:
    """A driver that opens directly after another was closed is accepted."""
    with serving(path):
        for _ in range(50):
            active(path).close()


def test_absent_rig(path: Path) -> None:
    """Without a rig the device is unavailable, and the text names the socket."""
    with pytest.raises(DeviceUnavailableError, match=str(path)):
        driver_of(path).open()


def test_other_axes_are_refused(path: Path) -> None:
    """A rig with other axes than configured is refused, and both are named."""
    with (
        serving(path, ("x", "y")),
        pytest.raises(DeviceError, match="has axes x, y, configured are x"),
    ):
        driver_of(path).open()


@pytest.mark.fault("B1")
def test_lost_rig_is_a_value(path: Path) -> None:
    """With a lost rig samples are invalid, writes are refused and the voltage is unknown."""
    with serving(path):
        driver = active(path)
    samples = driver.read(T0_NS)

    assert [sample.valid for sample in samples] == [False]
    assert driver.write([1.0], T0_NS + MS) is False
    assert math.isnan(driver.read_back(T0_NS + MS)[0])
    driver.close()


def test_driver_finds_its_rig_again(path: Path) -> None:
    """`read` finds a rig that came back, but not so soon that its absence is missed."""
    with serving(path):
        driver = active(path)
    driver.read(T0_NS)
    with serving(path):
        soon = driver.read(T0_NS + MS)
        later = driver.read(T0_NS + 200 * MS)
        driver.close()

    assert [sample.valid for sample in (*soon, *later)] == [False, True]


def test_new_start_of_the_rig_is_reported(path: Path) -> None:
    """The status reports for one second that the rig has restarted."""
    with serving(path):
        driver = active(path)
        before = driver.status(T0_NS)
    driver.read(T0_NS)
    with serving(path):
        driver.read(T0_NS + 200 * MS)
        found = driver.status(T0_NS + 300 * MS)
        after = driver.status(T0_NS + 1300 * MS)
        driver.close()

    restarted = frozenset({DeviceFlag.RESTARTED})
    assert (before, after) == ([NO_FLAGS] * 2, [NO_FLAGS] * 2)
    assert found == [NO_FLAGS, restarted]  # the input, the output


def test_another_rig_is_not_taken_for_the_lost_one(path: Path) -> None:
    """A rig with other axes at the same socket is not used."""
    with serving(path):
        driver = active(path)
    driver.read(T0_NS)
    with serving(path, ("x", "y")):
        (sample,) = driver.read(T0_NS + 200 * MS)
        driver.close()

    assert not sample.valid


def test_trace_lists_every_accepted_write(path: Path, tmp_path: Path) -> None:
    """The trace has the instant, the caller and the voltages of each write."""
    trace = tmp_path / "trace.csv"
    with serving(path, trace=trace):
        driver = active(path)
        driver.write([1.5], T0_NS)
        driver.write([math.nan], T0_NS + MS)
        driver.write([2.5], T0_NS + 2 * MS)
        driver.close()
    header, *rows = [line.split(",") for line in trace.read_text().splitlines()]

    assert header == ["t_ns", "asked_ns", "pid", "x_v"]
    assert [(int(row[1]), float(row[3])) for row in rows] == [(T0_NS, 1.5), (T0_NS + 2 * MS, 2.5)]
