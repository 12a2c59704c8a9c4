"""The device that fails on a schedule."""

import math
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from piezod.devices import registry
from piezod.devices.interface import Amplifier, Capabilities, Identity, KnowsTruth, Sample, Sensor
from piezod.devices.status import NO_FLAGS, DeviceFlag, TellsStatus
from piezod.testing.faulty import FaultyDevice, FaultyError
from piezod.testing.injections import Injection, InjectionKind

PIEZOD = Path(registry.__file__).parents[1]


class Rig:
    """Reads its time as µm, on both axes, and records the voltages."""

    def __init__(self) -> None:
        self.drive_v: Sequence[float] = (0.0, 0.0)
        self.done: list[str] = []

    def open(self) -> Identity:
        self.done.append("open")
        return Identity("maker", "model", "serial", "firmware")

    def capabilities(self) -> Capabilities:
        return Capabilities(("x", "y"), ("x", "y"), read_back=True, max_rate_hz=1000.0)

    def activate(self, now_ns: int) -> None:
        self.done.append(f"activate {now_ns}")

    def deactivate(self, now_ns: int) -> None:
        self.done.append(f"deactivate {now_ns}")

    def close(self) -> None:
        self.done.append("close")

    def read(self, now_ns: int) -> Sequence[Sample]:
        return [Sample(now_ns, float(now_ns), True)] * 2

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - protocol
        self.drive_v = tuple(drive_v)
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - protocol
        return self.drive_v


def failing(kind: InjectionKind, value: float = math.nan) -> FaultyDevice:
    """Return a rig that fails on axis 1 from 10 to 20 ns."""
    return FaultyDevice(Rig(), [Injection(kind, 10, 20, 1, value)])


def shown(device: FaultyDevice) -> list[Sample]:
    """Return the samples of axis 1 from 8 to 21 ns."""
    return [device.read(t_ns)[1] for t_ns in range(8, 22)]


def test_a_device_without_faults_is_the_device() -> None:
    """It has all roles and forwards every call."""
    rig = Rig()
    device = FaultyDevice(rig)
    device.open()
    device.activate(1)
    samples = device.read(2)
    taken = device.write([1.0, 2.0], 3)
    device.deactivate(4)
    device.close()

    assert isinstance(device, Sensor)
    assert isinstance(device, Amplifier)
    assert isinstance(device, KnowsTruth)
    assert isinstance(device, TellsStatus)
    assert (list(samples), taken, device.read_back(5)) == ([Sample(2, 2.0, True)] * 2, True, [1, 2])
    assert device.status(5) == [NO_FLAGS] * 4
    assert rig.done == ["open", "activate 1", "deactivate 4", "close"]


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (InjectionKind.STUCK, math.nan, [10.0, 10.0]),
        (InjectionKind.REPLACED, math.inf, [math.inf, math.inf]),
        (InjectionKind.OFFSET, 5.0, [15.0, 16.0]),
        (InjectionKind.GAIN, -1.0, [-10.0, -11.0]),
        (InjectionKind.LATE, 3.0, [8.0, 8.0]),
        (InjectionKind.DUPLICATE, math.nan, [9.0, 9.0]),
        (InjectionKind.DROPPED, math.nan, [10.0, 11.0]),
    ],
)
def test_a_faulty_displacement_is_so_from_start_to_end(
    kind: InjectionKind, value: float, expected: list[float]
) -> None:
    """The fault affects its own axis only, from its start to its end."""
    device = failing(kind, value)
    samples = shown(device)

    assert [sample.position_um for sample in samples[:4]] == [8.0, 9.0, *expected]
    assert [sample.position_um for sample in samples[-2:]] == [20.0, 21.0]
    assert [sample.valid for sample in samples[2:12]] == [kind is not InjectionKind.DROPPED] * 10
    assert device.read(30)[0] == Sample(30, 30.0, True)


@pytest.mark.parametrize("kind", [InjectionKind.NOISE, InjectionKind.GARBAGE])
def test_random_faults_are_the_same_each_time(kind: InjectionKind) -> None:
    """The seed determines them."""
    first, second = shown(failing(kind, 3.0)), shown(failing(kind, 3.0))

    assert first == second
    assert len({sample.position_um for sample in first}) == 14


def test_late_samples_are_old_by_their_time_stamps_too() -> None:
    """Late and duplicate samples keep their time stamps, as those of a buffering device."""
    assert [one.t_ns for one in shown(failing(InjectionKind.LATE, 2.0))[2:5]] == [8, 9, 10]
    assert [one.t_ns for one in shown(failing(InjectionKind.DUPLICATE))[2:5]] == [9, 9, 9]


def test_writes_are_refused_or_swallowed() -> None:
    """A refusal affects all axes, a stuck output one; afterwards writes work again."""
    refusing, stuck = failing(InjectionKind.REFUSED), failing(InjectionKind.STUCK_OUTPUT)
    answers = [
        [device.write([float(t_ns)] * 2, t_ns) for t_ns in (9, 10, 20)]
        for device in (refusing, stuck)
    ]
    stuck.write([21.0, 21.0], 15)

    assert answers == [[True, False, True], [True, True, True]]
    assert stuck.read_back(21) == [21.0, 20.0]


def test_status_and_read_back_can_be_wrong() -> None:
    """The faults affect one axis."""
    flagged = FaultyDevice(Rig(), [Injection(InjectionKind.FLAGGED, 0, flag=DeviceFlag.LOCAL_MODE)])

    assert flagged.status(5) == [{DeviceFlag.LOCAL_MODE}, NO_FLAGS] * 2
    flagged.schedule[0] = Injection(InjectionKind.SENSOR_FLAGGED, 0, flag=DeviceFlag.LOCAL_MODE)
    assert flagged.status(5) == [{DeviceFlag.LOCAL_MODE}, *[NO_FLAGS] * 3]
    assert failing(InjectionKind.READ_BACK_OFFSET, 7.0).read_back(12) == [0.0, 7.0]


def test_drivers_can_raise() -> None:
    """Reading and writing raise, which the contract forbids."""
    with pytest.raises(FaultyError, match="read"):
        failing(InjectionKind.READ_RAISES).read(12)
    with pytest.raises(FaultyError, match="wrote"):
        failing(InjectionKind.WRITE_RAISES).write([0.0, 0.0], 12)


def test_only_tests_can_use_it() -> None:
    """No driver uses it, and no module of the running program imports it."""
    plugins = [point.value for point in entry_points(group=registry.GROUP)]
    code = "import sys, piezod.cli.main; print(any('faulty' in name for name in sys.modules))"
    imported = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    sources = [
        path.name
        for path in PIEZOD.rglob("*.py")
        if "piezod.testing.faulty" in path.read_text(encoding="utf-8")
    ]

    assert plugins
    assert not any("faulty" in plugin for plugin in plugins)
    assert imported.stdout.strip() == b"False"
    assert sources == []
