"""The conversation with a PI controller that speaks GCS 1."""

from collections.abc import Sequence

from piezod.devices.bus.line import Line
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.gcs.dialogue import MEASURED, GcsDialogue, GcsDrive
from piezod_drivers.serial_line.gcs.rate import wire_rate_hz
from piezod_drivers.serial_line.pi_gcs1.codec import Gcs1Syntax
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options


class Gcs1Dialogue(GcsDialogue):
    """The conversation with a GCS 1 controller, which does not report the range of its outputs."""

    def __init__(self, line: Line, options: Gcs1Options, wiring: Wiring) -> None:
        drive = GcsDrive(MEASURED, wire_rate_hz(options.baud, len(wiring.channels)))
        super().__init__(line, options.timeout_ms * 1e-3, Gcs1Syntax(), wiring, drive)
        self._range_v = options.range_v

    def _output_ids(self, axes: Sequence[str]) -> Sequence[str]:  # noqa: ARG002 - the generation's
        """Return the axes: their voltages have the same letters."""
        return self.wiring.outputs

    def _find_ranges(self) -> list[tuple[float, float]]:
        return [self._range_v] * len(self.wiring.outputs)
