"""Takes the place of the watch of a sensor on an axis that has none."""

from collections.abc import Sequence
from math import nan

from piezod.control.faults.detection import Detection
from piezod.devices.interface import Sample
from piezod.devices.status import Flags


class AbsentSensor:
    """No sample, hence no fault. Real-time safe."""

    def __init__(self) -> None:
        self.noise_um = self.width_um = self.model_error_um = 0.0
        self.gain_um_per_v, self.answer_ns, self.rests = nan, 0, False
        self.ready = True
        """Modes of other axes need not wait for it; those of this axis are refused."""
        self.sample = Sample(0, nan, False)
        """The sample for use by the control law, never valid."""

    def check(
        self,
        t_ns: int,
        _sample: Sample,
        _flags: Flags,
        _in_force_v: float,
        _command_um: float,
        *,
        driven: bool,  # noqa: ARG002 - the signature is that of `SensorWatch`
        needed: bool,  # noqa: ARG002 - likewise
        reading_um: float | None = None,  # noqa: ARG002 - likewise
    ) -> Sequence[Detection]:
        """Return no fault. Call once per cycle, after the read."""
        self.sample = Sample(t_ns, nan, False)
        return ()

    def zeroed(self) -> None:
        """There is nothing to zero."""

    def allowed_um(self, _drive_v: float) -> tuple[float, float]:
        """Return NaN: without a measured position no position is excluded."""
        return nan, nan
