"""A wave: waveforms that the loop follows, with a recording of all cycles."""

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.motion import follow_waves, move_to
from piezod.bluesky.recorded import Column
from piezod.client.calls import Waveforms
from piezod.client.facts import AxisFacts
from piezod.client.request_bodies import tupled
from piezod.errors import ClientError, DataError, RefusedError
from piezod.messages.requests import Wave as WaveRequest

_LABEL: Final = "bluesky"


@dataclass(frozen=True)
class Wave:
    """Waveforms to follow, for a flyer."""

    command_um: Waveforms  #: Axis: position over time in µm, a waveform as in experiment files.
    duration_s: float  #: Duration, in s.

    async def prepare(self, link: ConnectedStage) -> None:
        """Check the waveforms, and move the axes to their start.

        Raises:
            RefusedError: If it is not a waveform, an axis is unknown, or its range is exceeded.
            NotReachedError: If an axis does not arrive at the start.
            ClientError: If the daemon does not answer.
        """
        start_um = self._start_um(link.facts)
        await asyncio.gather(*(move_to(link, axis, um) for axis, um in start_um.items()))

    async def fly(self, link: ConnectedStage, file: Path, begun: asyncio.Event) -> None:
        """Record all cycles while the stage follows the waveforms.

        Args:
            link: Connection to the stage.
            file: Where the recording is copied to.
            begun: Set when the daemon has accepted the waveforms.

        Raises:
            NotReachedError: If the stage was stopped, held, or moved by another client.
            DataError: If the recording has ended before the waveforms.
            ClientError: If the daemon refuses, or ends.
        """
        await link.daemon.start_recording(_LABEL)
        try:
            await follow_waves(link, self.command_um, self.duration_s, begun)
        except BaseException:
            with suppress(ClientError):  # the reason is the other error
                await link.daemon.stop_recording()
            raise
        recording = await link.daemon.stop_recording()
        if recording.why or recording.files > 1:
            why = recording.why or "it has several files, see recordings.max_file_mb"
            raise DataError(f"{link.title}: recording {recording.name}: {why}")
        await link.fetch_recording(recording.name, file)

    def columns(self, recorded: Sequence[Column]) -> list[Column]:
        """Return the columns that its file has."""
        return list(recorded)

    def _start_um(self, facts: Mapping[str, AxisFacts]) -> dict[str, float]:
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
            waveform = config.built(self.duration_s)
            low_um, high_um = facts[axis].range_um
            if waveform.low < low_um or waveform.high > high_um:
                what = f"axis {axis}: {waveform.low:g} to {waveform.high:g} µm"
                raise RefusedError(what, f"allowed: {low_um:g} to {high_um:g} µm", "value")
            start_um[axis] = waveform.value(0.0)
        return start_um
