"""A rig without physics: each axis goes where it is driven, in a straight line and at once."""

from collections.abc import Sequence

from piezod.devices.emulation.bench import Bench
from piezod.devices.interface import Capabilities, Identity, Sample
from tests.drivers.serial_line.scripted_line import TestTime

UM_PER_V = 0.2


class LinearRig:
    """Implements `piezod.devices.emulation.bench.Rig`.

    Args:
        n_axes: Number of axes.
    """

    def __init__(self, n_axes: int = 1) -> None:
        self.drive_v = [0.0] * n_axes
        self.valid = True
        self.highest_v = 150.0

    def open(self) -> Identity:
        return Identity("test", "linear", "1", "1")

    def capabilities(self) -> Capabilities:
        names = tuple(f"a{i}" for i in range(len(self.drive_v)))
        inputs = tuple(name for axis in names for name in (axis, f"{axis}_v"))
        return Capabilities(inputs, names, True, 1e6)

    def activate(self, now_ns: int) -> None:
        pass

    def deactivate(self, now_ns: int) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self, now_ns: int) -> Sequence[Sample]:
        return [
            Sample(now_ns, value, self.valid)
            for drive_v in self.drive_v
            for value in (drive_v * UM_PER_V, drive_v / 10)
        ]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - the interface's
        if not all(-20.0 <= value <= self.highest_v for value in drive_v):
            return False
        self.drive_v = list(drive_v)
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        return self.drive_v


def bench(n_axes: int = 1, time: TestTime | None = None) -> tuple[Bench, LinearRig, TestTime]:
    """Return a bench, the rig behind it and the clock of both."""
    clock = time or TestTime()
    rig = LinearRig(n_axes)
    return Bench(rig, clock.now_ns), rig, clock
