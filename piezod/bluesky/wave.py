"""A wave: what a flyer follows."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from piezod.bluesky.facts import AxisFacts
from piezod.client.calls import Waveforms
from piezod.client.waveforms import tupled
from piezod.config.requests import Wave as WaveRequest
from piezod.control.reference.waveforms import build_waveform
from piezod.errors import RefusedError


@dataclass(frozen=True)
class Wave:
    """Waveforms to follow.

    Attributes:
        command_um: Axis: position over time in µm, a waveform as in experiment files.
        duration_s: Duration, in s.
    """

    command_um: Waveforms
    duration_s: float

    def start_um(self, facts: Mapping[str, AxisFacts]) -> dict[str, float]:
        """Return the positions at which it starts, in µm.

        Args:
            facts: Limits of the axes.

        Raises:
            RefusedError: If it is not a waveform, an axis is unknown, or its range is exceeded.
        """
        try:
            request = WaveRequest.model_validate(
                {"command_um": tupled(self.command_um), "duration_s": self.duration_s}
            )
        except ValidationError as error:
            raise RefusedError(f"not a wave: {error}", code="value") from error
        start_um = {}
        for axis, config in request.command_um.items():
            if axis not in facts:
                raise RefusedError(f"no axis {axis}", f"axes: {', '.join(facts)}", "not_found")
            waveform = build_waveform(config, self.duration_s)
            low_um, high_um = facts[axis].range_um
            if waveform.low < low_um or waveform.high > high_um:
                what = f"axis {axis}: {waveform.low:g} to {waveform.high:g} µm"
                raise RefusedError(what, f"allowed: {low_um:g} to {high_um:g} µm", "value")
            start_um[axis] = waveform.value(0.0)
        return start_um
