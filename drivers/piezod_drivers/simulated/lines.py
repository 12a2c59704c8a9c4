"""The digital lines of a simulated rig that its loop reads and sets."""

from collections.abc import Sequence

from piezod.devices.interface import Sample, Wiring
from piezod.errors import DeviceError
from piezod_drivers.simulated.camera import CameraLine, CameraOptions

PREFIX = "line:"
"""Before the number of a line, so that no axis has its name."""
CAMERA = f"{PREFIX}camera"
OUTPUTS = tuple(f"{PREFIX}{number}" for number in range(1, 9))


def axes_of(wiring: Wiring) -> Wiring:
    """Return the channels of a wiring that are no lines."""
    inputs, outputs = (tuple(x for x in side if not x.startswith(PREFIX)) for side in wiring)
    return Wiring(inputs, outputs)


class RigLines:
    """The lines of a rig, which are behind the other channels of its wiring. Real-time safe.

    The input `line:camera` is high for a moment at each pulse of the camera. The other inputs are
    wired to the outputs of the same name, `line:1` to `line:8`.

    Args:
        wiring: The channels of the rig.
        camera: What pulses the input of the camera; None for nothing.
    """

    def __init__(self, wiring: Wiring, camera: CameraOptions | None) -> None:
        self._inputs, self._outputs = (
            [name for name in side if name.startswith(PREFIX)] for side in wiring
        )
        self._camera = CameraLine(camera)
        self._high = dict.fromkeys((CAMERA, *OUTPUTS), False)
        self.pulses = dict.fromkeys(OUTPUTS, 0)
        """Number of rising edges of each output."""

    def __bool__(self) -> bool:
        """Return whether lines are in use."""
        return bool(self._inputs or self._outputs)

    def check(self) -> None:
        """Refuse a line that a rig does not have.

        Raises:
            DeviceError: If there is one.
        """
        for name in (*self._inputs, *self._outputs):
            if name not in (OUTPUTS if name in self._outputs else self._high):
                raise DeviceError(
                    f"the rig has no {name}: its outputs are {OUTPUTS[0]} to {OUTPUTS[-1]}, its "
                    f"inputs these and {CAMERA}"
                )

    def samples(self, t_ns: int, now_ns: int) -> list[Sample]:
        """Return a sample of each input, at an instant in the time of the rig, in ns."""
        self._high[CAMERA] = self._camera.is_high(t_ns)
        return [Sample(now_ns, float(self._high[name]), True) for name in self._inputs]

    def values(self) -> list[float]:
        """Return the value of each output."""
        return [float(self._high[name]) for name in self._outputs]

    def set(self, values: Sequence[float]) -> None:
        """Set every output."""
        for name, value in zip(self._outputs, values, strict=True):
            high = value > 0.5
            self.pulses[name] += high and not self._high[name]
            self._high[name] = high
