"""A rig without physics: each axis follows its drive voltage linearly and at once."""

from collections.abc import Sequence

from piezod.devices.emulation.bench import UM_PER_V as UM_PER_SENSOR_V
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Capabilities, Identity, Sample
from piezod.units import NS_PER_S
from tests.drivers.serial_line.scripted_line import TestTime

UM_PER_V = 0.2
STEP_NS = 1000
"""Step of the rig, in ns."""


class LinearRig:
    """Implements `piezod.devices.emulation.bench.Rig`.

    Args:
        n_axes: Number of axes.
        um_per_v: Displacement per volt, in µm/V.

    Attributes:
        at_um: Displacement of each axis at 0 V, in µm.
        drive_v: Voltage of each axis, in V, in force as soon as it is written.
        driven_v: All written voltages, in V, in order.
        driven_ns: Instants of them, in ns.
        valid: Whether its samples are valid.
        highest_v: Higher voltages are refused, in V.
    """

    def __init__(self, n_axes: int = 1, um_per_v: float = UM_PER_V) -> None:
        self._um_per_v = um_per_v
        self.at_um = [0.0] * n_axes
        self.drive_v = [0.0] * n_axes
        self.driven_v: list[list[float]] = []
        self.driven_ns: list[int] = []
        self.valid = True
        self.highest_v = 150.0

    def open(self) -> Identity:
        return Identity("test", "linear", "1", "1")

    def capabilities(self) -> Capabilities:
        names = tuple(f"a{i}" for i in range(len(self.drive_v)))
        inputs = tuple(name for axis in names for name in (axis, f"{axis}_v"))
        return Capabilities(inputs, names, True, NS_PER_S / STEP_NS)

    def activate(self, now_ns: int) -> None:
        pass

    def deactivate(self, now_ns: int) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self, now_ns: int) -> Sequence[Sample]:
        driven = zip(self.at_um, self.drive_v, strict=True)
        return [
            Sample(now_ns, value, self.valid)
            for position_um in (at_um + drive_v * self._um_per_v for at_um, drive_v in driven)
            for value in (position_um, position_um / UM_PER_SENSOR_V)
        ]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        if not all(-20.0 <= value <= self.highest_v for value in drive_v):
            return False
        self.drive_v = list(drive_v)
        self.driven_v.append([*drive_v])
        self.driven_ns.append(now_ns)
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        return self.drive_v


def bench(n_axes: int = 1, time: TestTime | None = None) -> tuple[SharedRig, LinearRig, TestTime]:
    """Return a shared rig, the rig behind it and the clock of both."""
    clock = time or TestTime()
    rig = LinearRig(n_axes)
    return SharedRig(rig, clock.now_ns), rig, clock
