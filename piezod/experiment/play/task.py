"""What is learned: a command on an axis whose model and response are known."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from piezod.control.law.creep import CreepLaw
from piezod.dynamics.drift import Drift
from piezod.dynamics.harmonics import Harmonics
from piezod.dynamics.model import ResponseModel
from piezod.errors import DataError
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.response import KnownResponse
from piezod.experiment.play.tables import TableMaker
from piezod.hysteresis.memory import FloatArray

MOST_LEFT_OUT = 0.25
"""Largest share of its swing by which a command may differ from what can be learned of it."""


class PlaySettings(NamedTuple):
    """Settings of the plays."""

    passes: int  #: Largest number of corrections.
    settle_s: float  #: Time of the waveform before the periods that count, in s.
    record_s: float  #: Time of the periods that count, in s.


@dataclass(frozen=True, eq=False)
class LearningTask:
    """What is learned, and how."""

    given: PeriodicCommand  #: The command as given.
    command: PeriodicCommand  #: The command with learned harmonics only.
    maker: TableMaker  #: Makes tables for the axis.
    harmonics: Harmonics  #: Response and sensor at the harmonics of the command.
    static_gain: float  #: Mean displacement per mean input, with creep.
    settings: PlaySettings  #: Settings of the plays.
    drift: Drift  #: Drift of the axis, from all of its plays.
    #: (n,) input that was learned before, in µm; None to begin with the response.
    first_um: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class KnownAxis:
    """What is known of an axis."""

    maker: TableMaker  #: Makes tables for it, by its inverse model.
    creep: CreepLaw  #: Its creep.
    response: KnownResponse  #: From the input of the inverse model to the samples.
    sensor_delay_s: float  #: Part of the delay that is the sensor's, in s.
    drift: Drift = field(default_factory=Drift)  #: Its drift since the first play.

    def task(
        self,
        given: PeriodicCommand,
        settings: PlaySettings,
        first_um: FloatArray | None = None,
    ) -> LearningTask:
        """Return the task to learn a command.

        Harmonics whose response is not known well enough are left out of the command: they are
        neither driven nor learned.

        Args:
            given: The command.
            settings: Settings of the plays.
            first_um: (n,) input that was learned before, in µm; None to begin with the response.

        Raises:
            DataError: If the command leaves the model, or hardly anything of it remains.
        """
        self.maker.check(given.values_um)
        harmonics = Harmonics.known(
            given.harmonics_hz,
            self.response.at,
            ResponseModel(self.sensor_delay_s).at,
            self.response.uncertainty(given.harmonics_hz),
            self.response.shift,
        )
        command = given.only(harmonics.learned)
        left_out = left_out_share(given, command)
        if left_out > MOST_LEFT_OUT:
            raise DataError(
                f"{given.name}: {100 * left_out:.3g} % of the swing are at frequencies at which "
                "the response is too small or not known well enough, allowed: "
                f"{100 * MOST_LEFT_OUT:g} %; it is known up to {self.response.highest_hz:.4g} Hz, "
                "without the surroundings of modes with little damping"
            )
        gain = static_gain(self.creep, settings.settle_s + 0.5 * settings.record_s)
        return LearningTask(
            given, command, self.maker, harmonics, gain, settings, self.drift, first_um
        )


def left_out_share(given: PeriodicCommand, command: PeriodicCommand) -> float:
    """Return the largest difference of a command to the given one, as a share of the swing."""
    return float(np.max(np.abs(command.values_um - given.values_um))) / given.swing_um


def static_gain(creep: CreepLaw, after_s: float) -> float:
    """Return displacement with creep over displacement without, some time after a step, in s."""
    return 1.0 + float(creep.weights @ -np.expm1(-after_s / creep.time_constants_s))
