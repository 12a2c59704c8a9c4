"""Coupling of the axes of a simulated rig: each moves the others a little."""

from collections.abc import Mapping, Sequence
from math import exp

from piezod.devices.interface import Sample
from piezod.errors import DeviceError
from piezod_drivers.simulated.axis import SENSOR_V


class RigCoupling:
    """What the sensors show of the other axes.

    Args:
        shares: Axis: how far 1 µm of each other axis moves it, in µm.
        axes: Names of the axes of the rig.
        inputs: Index of the axis, and quantity, of each input.
        lag_ns: Time constant with which an axis follows the others, in ns.

    Raises:
        DeviceError: If it names an axis that the rig does not have, or an input is not calibrated.
    """

    def __init__(
        self,
        shares: Mapping[str, Mapping[str, float]],
        axes: Sequence[str],
        inputs: Sequence[tuple[int, str]],
        lag_ns: float = 0.0,
    ) -> None:
        named = {*shares, *(other for row in shares.values() for other in row)}
        if unknown := sorted(named - set(axes)):
            known = ", ".join(axes)
            raise DeviceError(f"coupling: no axis {', '.join(unknown)}, this rig has {known}")
        if any(quantity == SENSOR_V for _, quantity in inputs):
            raise DeviceError("coupling: needs calibrated sensors, leave out the inputs in V")
        self._inputs, self._lag_ns = inputs, lag_ns
        self._rows: list[list[tuple[int, float]]] = [[] for _ in axes]
        for axis, row in shares.items():
            for other, share in row.items():
                if axis != other:
                    self._rows[axes.index(axis)].append((axes.index(other), share))
        self._own_um, self._late_um, self._t_ns = [0.0] * len(axes), [0.0] * len(axes), 0

    def advance(self, own_um: Sequence[float], t_ns: int) -> list[float]:
        """Return the true displacement of each axis, in µm. Real-time safe.

        Args:
            own_um: True displacements of the axes by themselves, in µm.
            t_ns: Their instant, in ns, not before that of the last call.
        """
        passed_ns, self._t_ns = t_ns - self._t_ns, t_ns
        if passed_ns and self._lag_ns:
            kept, lag = exp(-passed_ns / self._lag_ns), self._lag_ns / passed_ns
            # Exact for displacements that change evenly from call to call.
            self._late_um = [
                kept * late + (1.0 - kept) * lag * (um - before)
                for late, um, before in zip(self._late_um, own_um, self._own_um, strict=True)
            ]
        self._own_um = list(own_um)
        return [
            um + sum(share * (own_um[j] - self._late_um[j]) for j, share in row)
            for um, row in zip(own_um, self._rows, strict=True)
        ]

    def samples(self, own: Sequence[Sample], of_axes: Sequence[Sample]) -> list[Sample]:
        """Return the samples of the inputs, at the instant of `advance`. Real-time safe.

        Args:
            own: Samples of the inputs by themselves.
            of_axes: Calibrated samples of all axes by themselves.
        """
        found = []
        for sample, (i, quantity) in zip(own, self._inputs, strict=True):
            um, valid = sample.position_um, sample.valid
            for j, factor in () if quantity else self._rows[i]:
                um += factor * (of_axes[j].position_um - self._late_um[j])
                valid = valid and of_axes[j].valid
            found.append(Sample(sample.t_ns, um, valid))
        return found
