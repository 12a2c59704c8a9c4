"""A z-stack of pymmcore-plus with the example device: python stack.py; prints JSON.

It moves the only stage that runs. The camera shows where the stage is.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import useq
from pymmcore_piezod import PiezodStage
from pymmcore_plus.experimental.unicore import SimpleCameraDevice, UniMMCore

FROM_UM, PLANES, STEP_UM = 4.0, 5, 2.0


class Camera(SimpleCameraDevice):
    """Images whose value is the position of the stage, in nm."""

    def __init__(self, stage: PiezodStage) -> None:
        super().__init__()
        self._stage = stage

    def get_exposure(self) -> float:
        """Return 1 ms."""
        return 1.0

    def set_exposure(self, exposure: float) -> None:
        """Do nothing."""

    def sensor_shape(self) -> tuple[int, int]:
        """Return the size of an image."""
        return 2, 2

    def dtype(self) -> Any:
        """Return the type of a pixel."""
        return np.uint16

    def snap(self, buffer: np.ndarray) -> Mapping[str, Any]:
        """Fill an image."""
        buffer[:] = round(1000.0 * self._stage.get_position_um())
        return {}


def main() -> None:
    """Acquire the planes by the engine of pymmcore-plus, and let it refuse one out of range."""
    core, stage = UniMMCore(), PiezodStage("x")
    core.loadPyDevice("z", stage)
    core.loadPyDevice("camera", Camera(stage))
    core.initializeDevice("z")
    core.initializeDevice("camera")
    core.setFocusDevice("z")
    core.setCameraDevice("camera")
    core.setAutoShutter(False)  # there is none
    planes_um: list[tuple[float, float]] = []

    def ready(image: np.ndarray, event: useq.MDAEvent, _meta: object) -> None:
        planes_um.append((event.z_pos or 0.0, 1e-3 * float(image.mean())))

    core.mda.events.frameReady.connect(ready)
    plan = useq.ZRangeAround(range=(PLANES - 1) * STEP_UM, step=STEP_UM)
    centre_um = FROM_UM + 0.5 * (PLANES - 1) * STEP_UM
    core.mda.run(useq.MDASequence(z_plan=plan, stage_positions=[useq.Position(z=centre_um)]))
    refused = ""
    try:
        core.setZPosition(1000.0)
    except Exception as error:  # noqa: BLE001 - whatever the core makes of it
        refused = str(error)
    core.stop("z")
    position_um = core.getZPosition()
    core.unloadAllDevices()
    print(json.dumps({"planes": planes_um, "refused": refused, "after": position_um}))


if __name__ == "__main__":
    main()
