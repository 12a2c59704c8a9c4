"""Coupling of the axes of a simulated rig: each moves the others a little."""

from collections.abc import Mapping, Sequence

import numpy as np

from piezod.devices.interface import Sample
from piezod.errors import DeviceError
from piezod_drivers.simulated.axis import SENSOR_V


class RigCoupling:
    """What the sensors show of the other axes.

    Args:
        shares: Axis: how far 1 µm of each other axis moves it, in µm.
        axes: Names of the axes of the rig.
        inputs: Index of the axis, and quantity, of each input.

    Raises:
        DeviceError: If it names an axis that the rig does not have, or an input is not calibrated.
    """

    def __init__(
        self,
        shares: Mapping[str, Mapping[str, float]],
        axes: Sequence[str],
        inputs: Sequence[tuple[int, str]],
    ) -> None:
        named = {*shares, *(other for row in shares.values() for other in row)}
        if unknown := sorted(named - set(axes)):
            known = ", ".join(axes)
            raise DeviceError(f"coupling: no axis {', '.join(unknown)}, this rig has {known}")
        if any(quantity == SENSOR_V for _, quantity in inputs):
            raise DeviceError("coupling: needs calibrated sensors, leave out the inputs in V")
        self.matrix = np.eye(len(axes))
        """Displacement of each axis over that of all axes by themselves."""
        for axis, row in shares.items():
            for other, share in row.items():
                self.matrix[axes.index(axis), axes.index(other)] = share
        self._inputs = inputs
        self._rows = [
            [(j, float(factor)) for j, factor in enumerate(self.matrix[i]) if factor and j != i]
            for i in range(len(axes))
        ]

    def samples(self, own: Sequence[Sample], of_axes: Sequence[Sample]) -> list[Sample]:
        """Return the samples of the inputs. Real-time safe.

        Args:
            own: Samples of the inputs by themselves.
            of_axes: Calibrated samples of all axes by themselves.
        """
        found = []
        for sample, (i, quantity) in zip(own, self._inputs, strict=True):
            um, valid = sample.position_um, sample.valid
            for j, factor in () if quantity else self._rows[i]:
                um += factor * of_axes[j].position_um
                valid = valid and of_axes[j].valid
            found.append(Sample(sample.t_ns, um, valid))
        return found
