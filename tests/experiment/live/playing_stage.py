"""A fake of a running stage whose device plays tables, in its own time."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from piezod.config.response_file import ResonanceConfig, ResponseFile
from piezod.devices.played_axis import AxisTable
from piezod.units import NS_PER_S, s_to_ns
from tests.config.test_response_file import RESPONSE
from tests.experiment.live_fakes import Document, FakeStage, stage_document
from tests.experiment.play.rig_axis import LIMITS, SENSOR_DELAY_S, RigAxis

KNOWN = RESPONSE.model_copy(
    update={
        "delay_s": 223e-6,
        "resonances": (ResonanceConfig(frequency_hz=807.0, damping=0.0291, share=1.0),),
        "high_hz": 2850.0,
    }
)
"""The response of the rig; the delay of a file is without the hold of a point."""
DEVICE = {"maker": "piezod", "model": "simulated stack", "serial": "seed 1"}
WAVE = {"command_um": {"kind": "sine", "low": 4.0, "high": 24.0, "frequency_hz": 200.0}}


class PlayingStage(FakeStage):
    """A fake stage with a simulated rig, which plays at once.

    Args:
        response: The response in its configuration; None for none.
    """

    def __init__(self, response: ResponseFile | None = KNOWN) -> None:
        document = stage_document(
            limits={
                "drive_min_v": LIMITS.drive_min_v,
                "drive_max_v": LIMITS.drive_max_v,
                "slew_v_per_s": LIMITS.slew_v_per_s,
                "rest_v": 0.0,
            },
            compensator={"sensor_delay_s": SENSOR_DELAY_S},
            response=response and response.model_dump(mode="json", exclude_none=True),
        )
        super().__init__(document)
        self._axis, self._record = RigAxis(), dict[str, Any]()

    def _answer(self, path: str, body: Mapping[str, Any]) -> Document:
        if path != "play":
            return super()._answer(path, body)
        if body:
            self._play(body)
            return {"motion": self.motion}
        return self._record

    def _play(self, body: Mapping[str, Any]) -> None:
        interval_ns = s_to_ns(body["interval_s"])
        lead_in_v, period_v = (np.array(body[key]) for key in ("lead_in_v", "drive_v"))
        record = self._axis.play(AxisTable(interval_ns, lead_in_v, period_v, body["cycles"]))
        self._axis.rest()
        self._record = {
            "device": DEVICE,
            "failed": "",
            "position_um": record.position_um.tolist(),
            "record_interval_s": record.interval_ns / NS_PER_S,
            "first_point": record.first_point,
        }
