"""Runs the control law on a recording, cycle by cycle, and compares drive and error.

The law gets the recorded command and the samples of the stand-in for the stage: the recorded
samples as long as its voltages are the recorded ones. While the stage followed no command, the
recorded voltage is driven.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezod.config.axes import AxisConfig
from piezod.config.modes import CORRECTED, Mode
from piezod.control.law.axis import CompensatedAxis, TimeFunction
from piezod.control.law.compensated import Start, check_identifier, compensated_axis
from piezod.control.law.model import StageModel, with_found_mode
from piezod.control.law.trim_gains import check_feedback
from piezod.devices.interface import Sample
from piezod.experiment.replay.recorded_axis import RecordedAxis
from piezod.experiment.replay.stand_in import StandIn
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S


@dataclass(frozen=True)
class Replay:
    """A recording and its replay; arrays of shape (n,)."""

    recorded: RecordedAxis  #: The recording.
    modes: NDArray[np.str_]  #: Mode of each cycle in the replay.
    next_v: FloatArray  #: Voltage in force after each cycle in the replay, in V.
    #: Position in the replay, in µm; NaN if the recorded sample may not be used.
    position_um: FloatArray

    @property
    def drive_difference_v(self) -> FloatArray:
        """Voltage of the replay minus the recorded one, in V."""
        return self.next_v - self.recorded.next_v

    @property
    def recorded_error_um(self) -> FloatArray:
        """Commanded minus measured position, in µm."""
        return self.recorded.command_um - self.recorded.position_um

    @property
    def error_um(self) -> FloatArray:
        """Commanded position minus that of the replay, in µm."""
        return self.recorded.command_um - self.position_um


def replay(
    recorded: RecordedAxis,
    config: AxisConfig,
    model: StageModel,
    stand_in: StageModel,
    modes: NDArray[np.str_],
    rate_hz: float,
) -> Replay:
    """Run the control law on a recording.

    Args:
        recorded: The recording.
        config: Configuration of the axis.
        model: Model for the control law, with its zero at rest.
        stand_in: Model that stands in for the stage where the voltages differ.
        modes: Mode of each cycle.
        rate_hz: Cycles per second.

    Raises:
        ModelError: If a gain of the configuration is not safe with this model.
    """
    period_s, config = 1.0 / rate_hz, with_found_mode(config, model)
    check_identifier(config, model.form)
    for each in CORRECTED:
        if each.value in modes:
            check_feedback(each, config, period_s, model.delay_s)
    law = _law(recorded, config, model, Mode(str(modes[0])), round(period_s * NS_PER_S))
    stage = StandIn(stand_in, recorded.in_force_v, period_s)
    next_v = np.empty_like(recorded.next_v)
    position_um = np.empty_like(recorded.position_um)
    # Plain lists: reading a number from an array in a loop takes several times as long.
    rows = zip(
        recorded.t_ns.tolist(),
        recorded.sample_ns.tolist(),
        recorded.position_um.tolist(),
        recorded.next_v.tolist(),
        recorded.follows.tolist(),
        recorded.skipped.tolist(),
        modes.tolist(),
        strict=True,
    )
    followed = False
    for k, (t_ns, sample_ns, measured_um, recorded_v, follows, skipped, mode) in enumerate(rows):
        position_um[k] = measured_um + stage.moved_um(k, law.in_force_v)
        if mode != law.compensator.mode.value:
            law.switch(Mode(mode))
        if skipped:
            law.pause_learning()
        if not follows:
            law.force(recorded_v)
        elif not followed:
            law.follow(_command(recorded), 0)
        followed = follows
        sample = Sample(sample_ns, float(position_um[k]), bool(np.isfinite(measured_um)))
        drive_v = law.update(t_ns, sample).drive_v
        # A voltage that the law did not make is in force as it was recorded, limits or not.
        next_v[k] = drive_v if follows else recorded_v
        law.applied(float(next_v[k]))
    return Replay(recorded, modes, next_v, position_um)


def _law(
    recorded: RecordedAxis, config: AxisConfig, model: StageModel, mode: Mode, period_ns: int
) -> CompensatedAxis:
    """Return the control law at the start of a recording, as after a long rest."""
    creep = model.at_rest(config.limits.rest_v, period_ns / NS_PER_S)
    start = Start(0, period_ns, float(recorded.in_force_v[0]))
    return compensated_axis(config, model, creep, mode, _command(recorded), start)


def _command(recorded: RecordedAxis) -> TimeFunction:
    """Return the recorded command over time, in µm; between two cycles a straight line."""
    known = np.flatnonzero(np.isfinite(recorded.command_um))
    times_s = (recorded.t_ns[known] / NS_PER_S).tolist()
    values_um = recorded.command_um[known].tolist()

    def value_um(t_s: float) -> float:
        after = bisect_right(times_s, t_s)
        if after in (0, len(times_s)):
            return float(values_um[0 if after == 0 else -1])
        before = after - 1
        share = (t_s - times_s[before]) / (times_s[after] - times_s[before])
        return float(values_um[before] + share * (values_um[after] - values_um[before]))

    return value_um
