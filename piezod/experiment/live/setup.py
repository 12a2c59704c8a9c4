"""Setup of a running stage, from its daemon: rate, axes, and the models in use."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from piezod.client import StageClient
from piezod.client.errors import unexpected
from piezod.client.request_bodies import tupled
from piezod.config.daemon import StageAxisConfig
from piezod.config.model_file import ModelFile
from piezod.config.transform import TransformConfig
from piezod.config.waveforms.waveform import Waveform
from piezod.control.law.model import StageModel, with_found_mode
from piezod.control.law.model_files import from_model_file
from piezod.control.reference.motion import Motion, lead_in, motion_limits, waveform_motion
from piezod.errors import DataError
from piezod.messages.documents import Document

AT_REST_V = 1e-3
"""Largest difference of a safe voltage and the rest voltage that counts as equal, in V."""


@dataclass(frozen=True)
class LiveAxis:
    """One axis of a running stage."""

    config: StageAxisConfig  #: Its configuration, without the path of its model.
    #: The model in use, as a file, with its learned parameters; None if there is none.
    file: ModelFile | None
    model: StageModel | None  #: The same model, with its zero at rest.
    range_um: tuple[float, float]  #: Lowest and highest position that may be commanded, in µm.
    period_s: float  #: Period of the loop, in s.

    @property
    def safe_at_rest(self) -> bool:
        """Whether its safe voltage is the rest voltage."""
        return abs(self.config.safe_v - self.config.limits.rest_v) <= AT_REST_V

    def motion(self, waveform: Waveform, duration_s: float, start_um: float) -> Motion:
        """Return the movement along a waveform, with the motion to its start.

        Args:
            waveform: Position over time, in µm.
            duration_s: Duration of the waveform, in s.
            start_um: Command before, constant, in µm.
        """
        config = with_found_mode(self.config, self.model)
        limits = motion_limits(config, self.range_um, self.period_s)
        before = lead_in(waveform, start_um, 0.0, limits)
        return waveform_motion(waveform, duration_s, before)


@dataclass(frozen=True)
class LiveSetup:
    """Setup of a running stage."""

    stage: str  #: Name of the stage.
    rate_hz: float  #: Cycles of its loop per second.
    seed: int  #: Seed of the random values in simulated devices.
    axes: Mapping[str, LiveAxis]  #: Axes, by name.
    document: Document  #: Its configuration, as the daemon reports it.

    @property
    def safe_at_rest(self) -> bool:
        """Whether all axes rest at their safe voltage."""
        return all(axis.safe_at_rest for axis in self.axes.values())

    @property
    def user_axes(self) -> Mapping[str, Document]:
        """User axes by name, with the keys of an axis."""
        found: Mapping[str, Document] = self.document.get("user_axes", {})
        return found

    def moved_by(self, name: str) -> tuple[str, ...]:
        """Return the axes that move an axis: all actuators move a user axis."""
        return tuple(self._transform.actuators) if name in self.user_axes else (name,)

    def user_speed(self, name: str, speeds_um_per_s: Mapping[str, float]) -> float:
        """Return how fast a user axis is, in its unit/s, if its actuators are as fast as this."""
        transform = self._transform
        at = list(transform.axes).index(name)
        ways = zip(transform.actuators, transform.frame().to_actuators, strict=True)
        return min(speeds_um_per_s[axis] / abs(row[at]) for axis, row in ways if row[at])

    @property
    def _transform(self) -> TransformConfig:
        return TransformConfig.model_validate(tupled(self.document["transform"]))

    def measured_axis(self, name: str | None, what: str) -> str:
        """Return the name of an axis with a sensor.

        Args:
            name: Its name; None for the only axis.
            what: What needs the sensor, for the message.

        Raises:
            DataError: If there is no such axis, or several, or it has no sensor.
        """
        names = ", ".join(self.axes)
        if name is None and len(self.axes) > 1:
            raise DataError(f"stage {self.stage} has several axes, {names}: name one with --axis")
        if name is not None and name not in self.axes:
            raise DataError(f"stage {self.stage} has no axis {name}; its axes are {names}")
        chosen = name or names
        if self.axes[chosen].config.sensor is None:
            raise DataError(
                f"axis {chosen} has no sensor, and {what} needs one: configure one, borrowed if "
                "need be; the result remains when it is gone"
            )
        return chosen

    def model_of(self, name: str) -> StageModel:
        """Return the model of an axis that plays.

        Raises:
            DataError: If it has none.
        """
        model = self.axes[name].model
        if model is None:
            raise DataError(no_model(name, "a table"))
        return model


def no_model(axis: str, what: str) -> str:
    """Return the text that an axis has no model, which something needs."""
    return (
        f"axis {axis} has no model, which {what} needs; `piezod identify --live --adopt` makes one"
    )


def read_setup(client: StageClient) -> LiveSetup:
    """Return the setup of the stage of a daemon.

    Raises:
        ClientError: If the daemon does not answer, or gives an unexpected answer.
        DataError: If a model does not hold at the rest voltage.
        ModelError: If a model in use is not valid.
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
    return LiveSetup(stage or client.place.stage, rate_hz, seed, axes, document)


def _axis(document: Document, used: Document | None, period_s: float) -> LiveAxis:
    file = None if used is None else ModelFile.model_validate(tupled(used))
    # The daemon has read the model file; its client need not have access to it.
    reported = {key: tupled(value) for key, value in document.items() if key != "model"}
    model, range_um = None, reported.get("command_range_um")
    if file is not None:
        model = from_model_file(file).zeroed_at(float(document["limits"]["rest_v"]))
        range_um = range_um or tuple(model.position_um)
    config = StageAxisConfig.model_validate({**reported, "command_range_um": range_um})
    low_um, high_um = config.command_range_um or (0.0, 0.0)
    return LiveAxis(config, file, model, (low_um, high_um), period_s)
