"""The digital lines of a simulated rig that its loop reads and sets."""

from collections.abc import Sequence

from piezod.devices.interface import Sample, Wiring
from piezod.errors import DeviceError
from piezod_drivers.simulated.camera import CameraLine, CameraOptions

PREFIX = "line:"
"""Before the name of a line, so that no axis has it."""
INPUTS = (f"{PREFIX}camera",)
OUTPUTS = tuple(f"{PREFIX}{number}" for number in range(1, 9))


def axes_of(wiring: Wiring) -> Wiring:
    """Return the channels of a wiring that are no lines."""
    return Wiring(*(tuple(x for x in side if not x.startswith(PREFIX)) for side in wiring))


class RigLines:
    """The lines of a rig, which are behind the other channels of its wiring. Real-time safe.

    Args:
        wiring: The channels of the rig.
        camera: What pulses the input `line:camera`; None for nothing.

    Raises:
        DeviceError: If the rig does not have a line.
    """

    def __init__(self, wiring: Wiring, camera: CameraOptions | None) -> None:
        self.inputs, self.outputs = (
            [name for name in side if name.startswith(PREFIX)] for side in wiring
        )
        if wrong := {*self.inputs} - {*INPUTS} | {*self.outputs} - {*OUTPUTS}:
            has = f"outputs {OUTPUTS[0]} to {OUTPUTS[-1]}, and input {INPUTS[0]}"
            raise DeviceError(f"the rig has no {', '.join(sorted(wrong))}: it has {has}")
        self._camera = CameraLine(camera)
        self.values = [0.0] * len(self.outputs)
        """Value of each output."""
        self.pulses = dict.fromkeys(OUTPUTS, 0)
        """Number of rising edges of each output."""

    def samples(self, t_ns: int, now_ns: int) -> list[Sample]:
        """Return a sample of each input, at an instant in the time of the rig, in ns."""
        return [Sample(now_ns, float(self._camera.is_high(t_ns)), True) for _ in self.inputs]

    def set(self, values: Sequence[float]) -> None:
        """Set every output."""
        for name, value, before in zip(self.outputs, values, self.values, strict=True):
            self.pulses[name] += value > before
        self.values = list(values)
