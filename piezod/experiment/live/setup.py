"""What a running stage is like, as its daemon tells it: rate, axes, and the models in use."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from piezod.client import StageClient
from piezod.client.errors import unexpected
from piezod.client.results import Document
from piezod.client.waveforms import tupled
from piezod.config.daemon import StageAxisConfig
from piezod.config.model_file import ModelFile
from piezod.control.law.model import StageModel
from piezod.control.law.model_files import from_model_file
from piezod.control.reference.motion import Motion, MotionLimits, waveform_motion
from piezod.control.reference.waveforms import Waveform
from piezod.control.stage.axis import SHORTEST_MOTION_CYCLES, SHORTEST_MOTION_PERIODS

AT_REST_V = 1e-3
"""A safe voltage is the rest voltage within this."""


@dataclass(frozen=True)
class LiveAxis:
    """One axis of a running stage.

    Attributes:
        config: Its configuration; without the path of its model.
        file: The model in use, with what it has learned; None where there is none.
        model: The same, its displacement counted from rest.
        range_um: Lowest and highest position that may be commanded, in µm.
        period_s: Period of the loop, in s.
    """

    config: StageAxisConfig
    file: ModelFile | None
    model: StageModel | None
    range_um: tuple[float, float]
    period_s: float

    @property
    def safe_at_rest(self) -> bool:
        """Whether its safe voltage is that at which it rests."""
        return abs(self.config.safe_v - self.config.limits.rest_v) <= AT_REST_V

    def motion(self, waveform: Waveform, duration_s: float, start_um: float) -> Motion:
        """Return how it goes along a waveform: with the way to its start before it.

        Args:
            waveform: Position over time, in µm.
            duration_s: How long the waveform is followed, in s.
            start_um: Where the command stays before.
        """
        shortest_s, mode = SHORTEST_MOTION_CYCLES * self.period_s, self.config.first_mode
        if mode is not None:
            shortest_s = max(shortest_s, SHORTEST_MOTION_PERIODS / mode.frequency_hz)
        motion_limits = MotionLimits(self.config.speed_um_per_s, shortest_s, *self.range_um)
        return waveform_motion(waveform, duration_s, start_um, 0.0, motion_limits)


@dataclass(frozen=True)
class LiveSetup:
    """A running stage.

    Attributes:
        stage: Its name.
        rate_hz: Cycles of its loop per second.
        seed: Of what is random in simulated devices.
        axes: By name.
        document: Its configuration, as the daemon tells it.
    """

    stage: str
    rate_hz: float
    seed: int
    axes: Mapping[str, LiveAxis]
    document: Document

    @property
    def safe_at_rest(self) -> bool:
        """Whether all axes rest at their safe voltage."""
        return all(axis.safe_at_rest for axis in self.axes.values())


def read_setup(client: StageClient) -> LiveSetup:
    """Ask a daemon what its stage is like.

    Raises:
        ClientError: If it does not answer, or something that is not understood.
        DataError: If a model leaves out the rest voltage.
        ModelError: If a model in use is none of a stage.
    """
    stage, document, used = client.status().stage, client.config(), client.params().axes
    try:
        rate_hz = float(document["rate_hz"])
        axes = {
            name: _axis(axis, used.get(name, {}).get("model"), 1.0 / rate_hz)
            for name, axis in document["axes"].items()
        }
    except (ValidationError, KeyError, TypeError) as error:
        raise unexpected(document, str(error)) from error
    seed = int(document.get("seed", 1))
    return LiveSetup(stage or client.socket.parent.name, rate_hz, seed, axes, document)


def _axis(document: Document, used: Document | None, period_s: float) -> LiveAxis:
    file = None if used is None else ModelFile.model_validate(tupled(used))
    # The daemon has read the model's file; whoever asks it need not be able to.
    told = {key: tupled(value) for key, value in document.items() if key != "model"}
    model, range_um = None, told.get("command_range_um")
    if file is not None:
        model = from_model_file(file).zeroed_at(float(document["limits"]["rest_v"]))
        range_um = range_um or tuple(model.position_um)
    config = StageAxisConfig.model_validate({**told, "command_range_um": range_um})
    low_um, high_um = config.command_range_um or (0.0, 0.0)
    return LiveAxis(config, file, model, (low_um, high_um), period_s)
