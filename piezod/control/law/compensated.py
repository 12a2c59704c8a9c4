"""A compensated axis, put together from its configuration and its model."""

from typing import NamedTuple

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import CompensatedAxis, Waveform
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepState
from piezod.control.law.identifier import DriveHistory, Identifier, LearningGate
from piezod.control.law.model import StageModel
from piezod.control.law.stability import refuse_unstable
from piezod.control.law.trim import Trim
from piezod.hysteresis import (
    AdaptiveIdentifier,
    Convergence,
    LMSIdentifier,
    NLMSIdentifier,
    RLSIdentifier,
    Shadowed,
)
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S, s_to_ns

FADE_S = 0.1
"""A switch of mode or of parameters is spread over this time."""
CONVERGED_WITHIN = 0.005
"""The identifier has converged when successive errors differ by less than this part of the range"""
CONVERGED_FOR_S = 1.0
"""and have done so for this long."""
JUDGED_EVERY_S = 1.0
"""What was learned is compared with what was known before after so long of learning."""
SPARE_ENTRIES = 4
"""Cycles that the drive history keeps beyond the delay: both ends, and late samples."""


def limits_of(config: AxisConfig) -> Limits:
    """Return what the drive of an axis may do."""
    limits = config.limits
    return Limits(limits.drive_min_v, limits.drive_max_v, limits.slew_v_per_s)


class Start(NamedTuple):
    """Where an axis is taken over.

    Attributes:
        t_ns: Instant at which its reference starts.
        period_ns: Period of the loop.
        in_force_v: Voltage in force, in V.
    """

    t_ns: int
    period_ns: int
    in_force_v: float


def check_identifier(config: AxisConfig, bank: FloatArray) -> None:
    """Refuse a gain with which the identifier could run away.

    Raises:
        ModelError: If there is one.
    """
    _adaptation(config, bank, np.zeros(bank.shape[1]))


def check_trim(config: AxisConfig, period_s: float, delay_s: float) -> None:
    """Refuse a gain of the trim that leaves too little margin on a stage.

    Args:
        config: Trim and first mode of the axis.
        period_s: Period of the loop, in s.
        delay_s: Delay from drive to sensor, in s.

    Raises:
        ModelError: If it does.
    """
    mode = config.first_mode
    refuse_unstable(
        config.trim.gain_per_s,
        period_s,
        delay_s + 0.5 * period_s,  # it counts from the middle of the cycle in which a voltage holds
        mode.frequency_hz if mode else None,
        mode.damping if mode else None,
    )


def compensated_axis(
    config: AxisConfig,
    model: StageModel,
    creep: CreepState,
    mode: Mode,
    reference_um: Waveform,
    start: Start,
) -> CompensatedAxis:
    """Return an axis that follows a reference from rest, its memory relaxed.

    Args:
        config: Limits and compensator of the axis.
        model: Its inverse model; the identifier starts from the same weights.
        creep: How far it has crept.
        mode: How the drive is made from the command.
        reference_um: Displacement over time since the start, in µm.
        start: Where it is taken over.
    """
    period_ns, delay_ns = start.period_ns, s_to_ns(model.delay_s)
    sensor_delay_ns = s_to_ns(config.compensator.sensor_delay_s)
    history = DriveHistory(start.in_force_v, entries=delay_ns // period_ns + SPARE_ENTRIES)
    adaptation = _adaptation(config, model.bank, model.weights)
    identifier = Identifier(
        Shadowed(adaptation, window=_cycles(JUDGED_EVERY_S, period_ns)),
        model.drive_v,
        model.position_um,
        history,
        delay_ns,
        None if np.any(model.weights) else _convergence(period_ns),
        LearningGate(period_ns, latency_ns=sensor_delay_ns),
        creep,
    )
    compensator = Compensator(
        model.bank,
        model.weights,
        mode=mode,
        fade_cycles=_cycles(FADE_S, period_ns),
        creep=creep,
        trimmed_follows=config.trim.base == "adaptive",
    )
    return CompensatedAxis(
        reference_um=reference_um,
        drive_v=model.drive_v,
        position_um=model.position_um,
        compensator=compensator,
        identifier=identifier,
        history=history,
        limits=limits_of(config),
        in_force_v=start.in_force_v,
        start_ns=start.t_ns,
        period_ns=period_ns,
        delay_ns=delay_ns,
        sensor_delay_ns=sensor_delay_ns,
        trim=_trim(config, period_ns),
        first_mode_hz=config.first_mode.frequency_hz if config.first_mode else None,
    )


def _convergence(period_ns: int) -> Convergence:
    return Convergence(CONVERGED_WITHIN, window=_cycles(CONVERGED_FOR_S, period_ns))


def _adaptation(config: AxisConfig, bank: FloatArray, weights: FloatArray) -> AdaptiveIdentifier:
    settings = config.compensator
    deadband = settings.deadband_pct / 100.0
    if settings.identifier == "rls":
        return RLSIdentifier(bank, weights, deadband=deadband)
    kind = LMSIdentifier if settings.identifier == "lms" else NLMSIdentifier
    identifier = kind(bank, gain=settings.lms_gain, deadband=deadband)
    identifier.adopt(weights)
    return identifier


def _trim(config: AxisConfig, period_ns: int) -> Trim:
    trim = config.trim
    return Trim(
        trim.gain_per_s,
        period_ns / NS_PER_S,
        trim.authority_pct / 100.0,
        _cycles(FADE_S, period_ns),
    )


def _cycles(duration_s: float, period_ns: int) -> int:
    return max(1, s_to_ns(duration_s) // period_ns)
