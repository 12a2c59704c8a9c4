"""One axis on the simulated rig, for long and for disturbed runs in virtual time."""

import fcntl
import pickle
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.modes import Mode
from piezod.control.law.axis import TimeFunction
from piezod.control.law.compensated import Start, compensated_axis
from piezod.control.law.model import StageModel
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Sample, Wiring
from piezod.devices.wiring import ChannelPair
from piezod.experiment.virtual.creeping import Creeping
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import (
    COMMAND_UM,
    POSITION_UM,
    TRUE_UM,
    VirtualStage,
    opened,
)
from piezod.hysteresis import Shadowed
from piezod.hysteresis.memory import FloatArray
from piezod.plant.plant import Plant
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from tests.experiment.beyond import brief, experiment_of, with_stops

LOW_UM, HIGH_UM = 1.0, 25.0
"""Full swing. Below it, creep and drift would need negative voltages, which the amplifier
refuses."""
MIDDLE_UM, SWING_UM = (LOW_UM + HIGH_UM) / 2.0, HIGH_UM - LOW_UM
CYCLE_S = 2.0
"""Period of the full swing."""
APPROACH_S = 2.0


class Identified(NamedTuple):
    """An experiment with one axis, and the model of its stage."""

    config: ExperimentConfig
    model: StageModel

    def at(self, rate_hz: float) -> "Identified":
        """Return the same with another rate of the loop."""
        return self._replace(config=self.config.model_copy(update={"rate_hz": rate_hz}))

    def learning_by(self, identifier: str) -> "Identified":
        """Return the same with another identifier."""
        return self._replace(config=_with_compensator(self.config, identifier=identifier))

    def trimming_adaptive(self) -> "Identified":
        """Return the same with the trim on top of mode `adaptive`."""
        axis = self.config.axes["x"]
        trim = axis.trim.model_copy(update={"base": "adaptive"})
        return self._replace(config=_with_axis(self.config, trim=trim))


def _with_compensator(config: ExperimentConfig, **update: object) -> ExperimentConfig:
    compensator = config.axes["x"].compensator.model_copy(update=update)
    return _with_axis(config, compensator=compensator)


def _with_axis(config: ExperimentConfig, **update: object) -> ExperimentConfig:
    axis = config.axes["x"].model_copy(update=update)
    return config.model_copy(update={"axes": {"x": axis}})


def identified(folder: Path, thresholds: str, *, whole: bool = True) -> Identified:
    """Identify the stage of `beyond.yaml` by stops, once for all processes that share a folder.

    Args:
        folder: Where to keep the model.
        thresholds: Where the thresholds are, as in a configuration.
        whole: Whether the rate and the record are those of the file, and not half of them.
    """
    config = with_stops(experiment_of("stack"), thresholds)
    config = config if whole else brief(config)
    kept = folder / f"{thresholds}-{config.rate_hz:g}.pickle"
    with kept.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            with opened(config, lambda _cycles: None) as stage:
                kept.write_bytes(pickle.dumps(identify_axes(stage, config)["x"].model))
        return Identified(config, pickle.loads(kept.read_bytes()))  # noqa: S301 - our own


def swing_um(t_s: float) -> float:
    """Return a full swing that starts at the middle, upwards."""
    return MIDDLE_UM + 0.5 * SWING_UM * float(np.sin(2.0 * np.pi * t_s / CYCLE_S))


def approached(reference_um: TimeFunction, approach_s: float) -> TimeFunction:
    """Return a reference from rest to the start of another one, and then along it."""
    start_um = reference_um(0.0)

    def value(t_s: float) -> float:
        if t_s < approach_s:
            return start_um * max(t_s, 0.0) / approach_s
        return reference_um(t_s - approach_s)

    return value


class FaultyChannels(Channels):
    """Channels of one axis whose samples a test can change.

    Attributes:
        gain: What the stage does is multiplied by it, in truth and for the sensor alike.
        tamper: Returns the sample that the loop gets; called once per cycle.
    """

    gain = 1.0
    tamper: Callable[[Sample], Sample] | None = None

    def read(self, now_ns: int) -> list[Sample]:
        """Return a sample, changed by the test."""
        (sample,) = super().read(now_ns)
        sample = sample._replace(position_um=self.gain * sample.position_um)
        return [sample if self.tamper is None else self.tamper(sample)]

    def true_position_um(self, now_ns: int) -> list[float]:
        """Return the true displacement."""
        return [self.gain * super().true_position_um(now_ns)[0]]


class StressRig:
    """A stage that was zeroed at rest, and its axis at the start of a reference.

    Two rigs made alike do the same to the bit.

    Args:
        stage: The stage, as it was identified.
        reference_um: Displacement over time.
        mode: How the drive is made.
        approach_s: Duration of the way to the start, and of the rest before it.
    """

    def __init__(
        self,
        stage: Identified,
        reference_um: TimeFunction,
        mode: Mode = Mode.ADAPTIVE,
        approach_s: float = APPROACH_S,
    ) -> None:
        config, self._model = stage
        device = config.devices["rig"]
        rig = registry.load(device.driver).create(device.options, Wiring.both("x"), config.seed)
        self._rig = cast("SimulatedRig", rig)
        self.channels = FaultyChannels({"rig": rig}, {"x": ChannelPair("rig", "rig")})
        self.channels.open()
        self.channels.activate(0)
        self.stage = VirtualStage(self.channels, config, lambda _cycles: None)
        rest_v = config.axes["x"].limits.rest_v
        creeping = Creeping(self._model, rest_v, self.stage.period_ns / NS_PER_S)
        creeping.watch(self.stage.rest(approach_s)[0][:, POSITION_UM])
        creeping.zero()
        self.axis = compensated_axis(
            config.axes["x"],
            self._model,
            creeping.state,
            mode,
            approached(reference_um, approach_s),
            Start(self.stage.now_ns, self.stage.period_ns, self.stage.in_force_v[0]),
        )
        self.run(approach_s)

    def run(self, duration_s: float, before: Callable[[int], None] | None = None) -> FloatArray:
        """Continue the reference; return the trace, shape (cycles, COLUMNS)."""
        trace: FloatArray = self.stage.run([self.axis], duration_s, before)[0]
        return trace

    @property
    def plant(self) -> Plant:
        """Physics of the stage."""
        return self._rig._channels[0].plant  # noqa: SLF001 - a fault inside of the device

    @property
    def learned(self) -> FloatArray:
        """All learned parameters, for a comparison to the bit."""
        identifier = self.axis.identifier
        return np.array([*identifier.weights, identifier.offset, identifier.scale])

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return self.axis.compensator.merged_pairs + self.axis.identifier.merged_pairs

    @property
    def restored(self) -> int:
        """Number of returns to the last good model."""
        return cast("Shadowed", self.axis.identifier.adaptation).restored

    def moved_pct(self, learned: FloatArray, other: FloatArray) -> float:
        """Return the largest difference of the drives of two models, in % of the range."""
        return float(np.max(np.abs(self._drives(learned) - self._drives(other)))) * 100.0

    def _drives(self, learned: FloatArray) -> FloatArray:
        weights, offset, scale = learned[:-2], learned[-2], learned[-1]
        y = (1.0 + scale) * _PATH - offset
        inside = np.clip(y, 0.0, 1.0)
        drives: FloatArray = self._model.form.drives_at(weights, inside) + (y - inside)
        return drives


_TURNS = (0.0, 1.0, 0.0, 0.7, 0.2, 0.6, 0.3, 0.5, 0.4, 1.0, 0.4, 0.8, 0.5, 0.7)
_PATH = np.concatenate([np.linspace(start, end, 200) for start, end in pairwise(_TURNS)])
"""Displacements over the whole range, in loops of many sizes."""


def errors_pct(trace: FloatArray) -> FloatArray:
    """Return the error of the true displacement, in % of the full swing, shape (cycles,)."""
    error: FloatArray = (trace[:, TRUE_UM] - trace[:, COMMAND_UM]) * (100.0 / SWING_UM)
    return error


def worst_pct(trace: FloatArray) -> float:
    """Return the worst error of the true displacement, in % of the full swing."""
    return float(np.max(np.abs(errors_pct(trace))))


def worst_by_cycle_pct(trace: FloatArray, rate_hz: float) -> FloatArray:
    """Return the worst true error in each whole cycle of the full swing, shape (cycles,)."""
    each = round(CYCLE_S * rate_hz)
    error = np.abs(errors_pct(trace))
    worst: FloatArray = np.max(error[: error.size // each * each].reshape(-1, each), axis=1)
    return worst


def listed(values: FloatArray) -> str:
    """Return values as a line of a table."""
    return " ".join(f"{value:.2f}" for value in values)
