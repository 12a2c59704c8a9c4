"""The physics behind an emulated device's connectors: stages, amplifiers, sensors, in real time."""

from collections.abc import Callable, Sequence
from math import nan
from typing import Final, Protocol

from piezod.devices.interface import Amplifier, Sensor

UM_PER_V: Final = 5.0
"""Scale of a conditioned sensor output: 30 µm are 6 V."""


class Rig(Sensor, Amplifier, Protocol):
    """A sensor and amplifier in one, with the inputs `a` and `a_v` for each output `a`."""


class Bench:
    """What an emulator can do with its connectors.

    Args:
        rig: The rig, open and active; its inputs are a displacement and a sensor voltage for each
            output: x, x_v, y, y_v, …
        now_ns: The clock.
        wrote: Told every voltage that is taken: instant, axis, voltage in V.
    """

    def __init__(
        self,
        rig: Rig,
        now_ns: Callable[[], int],
        wrote: Callable[[int, int, float], None] = lambda _t_ns, _axis, _drive_v: None,
    ) -> None:
        self._rig, self.now_ns, self._wrote = rig, now_ns, wrote
        self.n_axes = len(rig.capabilities().outputs)
        self._drive_v: list[float] = [0.0] * self.n_axes

    def position_um(self, axis: int) -> float:
        """Give the measured displacement of an axis, in µm; NaN where its sensor is saturated."""
        sample = self._rig.read(self.now_ns())[2 * axis]
        return sample.position_um if sample.valid else nan

    def sensor_v(self, axis: int) -> float:
        """Give what the fibre sensor of an axis gives, in V, not linearised."""
        return self._rig.read(self.now_ns())[2 * axis + 1].position_um

    def conditioned_v(self, axis: int) -> float:
        """Give the linear output of a sensor's conditioner, in V: `UM_PER_V` µm each."""
        return self.position_um(axis) / UM_PER_V

    def drive(self, axis: int, drive_v: float) -> bool:
        """Command the amplifier of an axis to a voltage at the actuator, in V; tell if it can."""
        wanted_v: Sequence[float] = [
            drive_v if i == axis else before_v for i, before_v in enumerate(self._drive_v)
        ]
        t_ns = self.now_ns()
        if not self._rig.write(wanted_v, t_ns):
            return False
        self._drive_v[axis] = drive_v
        self._wrote(t_ns, axis, drive_v)
        return True

    def drive_v(self, axis: int) -> float:
        """Measure the voltage at the actuator of an axis, in V."""
        return self._rig.read_back(self.now_ns())[axis]
