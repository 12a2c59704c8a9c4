"""Stops a run in virtual time whose stage oscillates, as a daemon does."""

from collections.abc import Mapping
from math import isfinite

import numpy as np

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.control.faults.table import FAULTS, INDEX
from piezod.control.stage.zeroing import ZERO_OVER_S
from piezod.control.watch.adaptation import Oscillation
from piezod.errors import ModelError
from piezod.hysteresis import AffineRange
from piezod.hysteresis.memory import FloatArray
from piezod.telemetry.record import CycleRecord
from piezod.units import NS_PER_S


class RingingWatch:
    """Watches all axes of a run in a mode that needs the sensor.

    Args:
        run: Name of the run, for people.
        ranges_um: Range of the positions of each axis, in µm, by name, in the order of the cycles.
        at_rest_um: (axes, n) positions of the rest before, in µm: their end shows the noise.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self,
        run: str,
        ranges_um: Mapping[str, AffineRange],
        at_rest_um: FloatArray,
        period_ns: int,
    ) -> None:
        self._run, self._ranges_um, self._period_ns = run, ranges_um, period_ns
        last = at_rest_um[:, -max(2, round(ZERO_OVER_S * NS_PER_S / period_ns)) :]
        self._noise = [
            float(np.std(one[np.isfinite(one)])) / range_um.width if np.isfinite(one).any() else 0.0
            for one, range_um in zip(last, ranges_um.values(), strict=True)
        ]
        self._waves = [Oscillation(period_ns) for _ in ranges_um]

    def see(self, record: CycleRecord) -> None:
        """Take a cycle.

        Raises:
            ModelError: If an axis oscillates.
        """
        for i, (name, range_um) in enumerate(self._ranges_um.items()):
            axis, wave = record.axes[i], self._waves[i]
            if not isfinite(axis.position_um):
                continue
            command, position = map(range_um.to_unit, (axis.command_um, axis.position_um))
            wave.update(command, position, self._noise[i])
            if wave.found:
                raise ModelError(self._why(name, axis.mode, wave.amplitude * range_um.width))

    def _why(self, name: str, mode: Mode, amplitude_um: float) -> str:
        return (
            f"{self._run}: axis {name} oscillates by ±{amplitude_um:.3g} µm in mode {mode} "
            f"({Fault.D6}): {FAULTS[INDEX[Fault.D6]].remedy}"
        )
