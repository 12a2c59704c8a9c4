"""A compensated axis, put together from its configuration and its model."""

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.control.axis import CompensatedAxis, Waveform
from piezod.control.compensator import Compensator
from piezod.control.drive_history import DriveHistory
from piezod.control.identifier import Identifier
from piezod.control.limits import Limits
from piezod.experiment.fit import StageModel
from piezod.hysteresis import Convergence, LMSIdentifier
from piezod.units import s_to_ns

FADE_S = 0.1
"""A switch of mode or of parameters is spread over this time."""
CONVERGED_WITHIN = 0.005
"""The identifier has converged when successive errors differ by less than this part of the range"""
CONVERGED_FOR_S = 1.0
"""and have done so for this long."""


SPARE_ENTRIES = 4
"""Cycles that the drive history keeps beyond the delay: both ends, and late samples."""


def limits_of(config: AxisConfig) -> Limits:
    """Return what the drive of an axis may do."""
    limits = config.limits
    return Limits(limits.drive_min_v, limits.drive_max_v, limits.slew_v_per_s)


def compensated_axis(
    config: AxisConfig,
    model: StageModel,
    mode: Mode,
    reference_um: Waveform,
    in_force_v: float,
    start_ns: int,
    period_ns: int,
) -> CompensatedAxis:
    """Return an axis that follows a reference from rest, its memory relaxed.

    Args:
        config: Limits and compensator of the axis.
        model: Its inverse model; the identifier starts from the same weights.
        mode: How the drive is made from the command.
        reference_um: Displacement over time since the start, in µm.
        in_force_v: Voltage in force, in V.
        start_ns: Instant at which the reference starts.
        period_ns: Period of the loop.
    """
    settings = config.compensator
    delay_ns = s_to_ns(model.delay_s)
    history = DriveHistory(in_force_v, entries=delay_ns // period_ns + SPARE_ENTRIES)
    lms = LMSIdentifier(model.bank, gain=settings.lms_gain, deadband=settings.deadband_pct / 100.0)
    lms.weights[:] = model.weights
    identifier = Identifier(
        lms,
        model.drive_v,
        model.position_um,
        history,
        delay_ns,
        Convergence(CONVERGED_WITHIN, window=_cycles(CONVERGED_FOR_S, period_ns)),
    )
    compensator = Compensator(
        model.bank, model.weights, mode=mode, fade_cycles=_cycles(FADE_S, period_ns)
    )
    return CompensatedAxis(
        reference_um=reference_um,
        drive_v=model.drive_v,
        position_um=model.position_um,
        compensator=compensator,
        identifier=identifier,
        history=history,
        limits=limits_of(config),
        in_force_v=in_force_v,
        start_ns=start_ns,
        period_ns=period_ns,
        delay_ns=delay_ns,
    )


def _cycles(duration_s: float, period_ns: int) -> int:
    return max(1, s_to_ns(duration_s) // period_ns)
