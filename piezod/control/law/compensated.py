"""Builds the control law of an axis from its configuration and its model."""

from dataclasses import replace
from math import inf
from typing import NamedTuple

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.modes import CORRECTED, Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import CompensatedAxis, TimeFunction
from piezod.control.law.compensator import Compensator, DriveHistory
from piezod.control.law.creep import CreepState
from piezod.control.law.dynamics import (
    SPARE_ENTRIES,
    ModalMotion,
    StageDynamics,
    known_dynamics,
)
from piezod.control.law.held_delay import shown_share, stage_delay
from piezod.control.law.identifier import Identifier, LearningGate
from piezod.control.law.learned_models import LearnedBound, LearnedUse, ModelErrors, ModelProof
from piezod.control.law.learned_share import learned_share
from piezod.control.law.model import StageModel, with_found_mode
from piezod.control.law.pace import FOLLOWED_SHARE, learning_pace
from piezod.control.law.trim import NotchedTrim, Trim
from piezod.control.law.trim_gains import check_feedback, feedback_law
from piezod.control.reference.preview import ReferenceShaper
from piezod.dynamics import ResponseModel
from piezod.dynamics.notch import notch
from piezod.dynamics.preview import preview_filter
from piezod.errors import ModelError
from piezod.hysteresis import (
    AdaptiveIdentifier,
    Convergence,
    LearnedModel,
    LMSIdentifier,
    ModelForm,
    NLMSIdentifier,
    RLSIdentifier,
    Shadowed,
    StopForm,
    SurfaceForm,
    SurfaceIdentifier,
    covariance,
    has_even_thresholds,
)
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S, s_to_ns

FADE_S = 0.1
"""Duration over which a change of mode or of parameters is faded."""
CONVERGED_WITHIN = 0.005
"""Largest difference of successive errors, as a share of the range, in an identifier that has
converged; the criterion of the paper, section 2.3."""
CONVERGED_FOR_S = 1.0
"""The differences must stay that small for this long; the paper asks for a single one."""
SHADOW_WINDOW_S = 1.0
"""The learned model is compared with the last good one after this time of learning."""
PROOF_WINDOW_S = 1.0
"""The tracking error with the learned model is judged after this time of following a command."""
UNSEEN_LAG_CYCLES = 0.5
"""Largest lag of samples that says nothing about a stage whose mode rings between them."""
FASTER = 0.9
"""Share of the period of its identification up to which that of a loop is clearly shorter: the
period of a record is a mean of its times."""
LAG_CYCLES = 3
"""Delay beyond that of the stage that explains a tracking error, in cycles: hold, mode, rounding of
corners."""


def limits_of(config: AxisConfig) -> Limits:
    """Return the limits of the drive of an axis."""
    limits = config.limits
    return Limits(limits.drive_min_v, limits.drive_max_v, limits.slew_v_per_s)


class Start(NamedTuple):
    """Conditions under which an axis starts."""

    t_ns: int  #: Instant at which its reference starts, in ns.
    period_ns: int  #: Period of the loop, in ns.
    in_force_v: float  #: Voltage in force, in V.


def check_identifier(config: AxisConfig, form: ModelForm) -> None:
    """Refuse a gain, and a form, with which the identifier could diverge.

    Raises:
        ModelError: If the gain is not safe for this form, or if the identifier needs another one.
    """
    # The identifiers check their gain when they are built.
    _adaptation(config, form, form.straight_line(), 1.0)


def compensated_axis(
    config: AxisConfig,
    model: StageModel,
    creep: CreepState,
    mode: Mode,
    reference_um: TimeFunction,
    start: Start,
) -> CompensatedAxis:
    """Return an axis that follows a reference from rest.

    Args:
        config: Configuration of the axis.
        model: Model of the axis; the identifier starts from its weights.
        creep: State of the stage.
        mode: Mode in which the axis starts.
        reference_um: Position over time since the start, in µm.
        start: Conditions at the start.
    """
    period_ns, period_s = start.period_ns, start.period_ns / NS_PER_S
    dynamics = known_dynamics(config, period_s)
    model = in_loop(config, model, dynamics, period_s)
    delay_ns = s_to_ns(model.delay_s)
    sensor_delay_ns = delay_ns - s_to_ns(stage_delay_of(config, model, period_s))
    # Long enough for the delay, so that no sample is paired with the oldest entry.
    history = DriveHistory(start.in_force_v, max(delay_ns, 0) // period_ns + SPARE_ENTRIES)
    pace = _pace(config, model.form, period_ns)
    modal = _modal(dynamics, period_ns, creep.quick)
    proof = _proof(model, period_ns, _learned_use(config, model.form, period_ns))
    identifier = _identifier(config, model, creep, history, period_ns, modal, proof.first)
    compensator = Compensator(
        model.form,
        model.weights,
        mode=mode,
        fade_cycles=_cycles(FADE_S, period_ns),
        share=FOLLOWED_SHARE * pace,
        creep=creep,
        learning=learning_modes(config),
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
        feedbacks={each: _feedback(each, config, model, period_ns) for each in CORRECTED},
        proof=proof,
        bound=_bound(config, model, identifier.adaptation, period_ns),
        shaper=shaper_of(config, dynamics, period_s),
        modal=modal,
        rests_inside=model.rests_inside(config.limits.rest_v),
    )


def learning_modes(config: AxisConfig) -> frozenset[Mode]:
    """Return the modes in which the model in use follows the identifier."""
    trimmed = {Mode.TRIMMED} if config.trim.base == "adaptive" else set[Mode]()
    return frozenset({Mode.ADAPTIVE, Mode.CLOSED} | trimmed)


def _identifier(
    config: AxisConfig,
    model: StageModel,
    creep: CreepState,
    history: DriveHistory,
    period_ns: int,
    modal: ModalMotion | None,
    first: LearnedModel,
) -> Identifier:
    pace = _pace(config, model.form, period_ns)
    adaptation = _adaptation(config, model.form, model.weights, pace)
    if creep.memory is not None:
        adaptation.take_over(creep.memory)
    return Identifier(
        Shadowed(adaptation, window=_cycles(SHADOW_WINDOW_S, period_ns)),
        model.drive_v,
        model.position_um,
        history,
        s_to_ns(model.delay_s),
        period_ns,
        _convergence(model, period_ns),
        LearningGate(period_ns, latency_ns=s_to_ns(config.compensator.sensor_delay_s)),
        creep,
        modal,
        ModelErrors(
            model.form, first, adaptation, creep.memory, lag_known=config.response is not None
        ),
    )


def in_loop(
    config: AxisConfig, model: StageModel, dynamics: StageDynamics | None, period_s: float
) -> StageModel:
    """Return the model of an axis for a loop with this period, in s."""
    held_s, mode = model.held_s, with_found_mode(config, model).first_mode
    model = model.at(period_s)
    if dynamics is not None:
        # The delay of a response is more accurate: an identification's is of slow motion only.
        return replace(model, delay_s=dynamics.delay_s)
    if held_s is None or period_s > FASTER * held_s:
        return model
    # In a slower loop a mode that rings hides the delay of the sensor; but no stage is early.
    sensor_delay_s = config.compensator.sensor_delay_s
    least_s = sensor_delay_s + stage_delay(-inf, sensor_delay_s, period_s, mode)
    return replace(model, delay_s=max(model.delay_s, least_s))


def stage_delay_of(config: AxisConfig, model: StageModel, period_s: float) -> float:
    """Return the delay of the stage without that of its sensor, in s.

    Args:
        config: Configuration of the axis. Known modes are shaped for, so that they delay nothing.
        model: Model for a loop with this period.
        period_s: Period of the loop, in s.
    """
    sensor_delay_s = config.compensator.sensor_delay_s
    if config.response is not None:
        return model.delay_s - sensor_delay_s
    return stage_delay(model.delay_s, sensor_delay_s, period_s, config.first_mode)


def shaper_of(
    config: AxisConfig, dynamics: StageDynamics | None, period_s: float
) -> ReferenceShaper:
    """Return what shapes the references of an axis for its modes."""
    first_mode_hz = config.first_mode.frequency_hz if config.first_mode else None
    preview = None
    if dynamics is not None and dynamics.modes:
        preview = preview_filter(ResponseModel(0.0, dynamics.modes), period_s)
    return ReferenceShaper(period_s, first_mode_hz, preview)


def _modal(dynamics: StageDynamics | None, period_ns: int, position: float) -> ModalMotion | None:
    if dynamics is None or not dynamics.modes:
        return None
    return ModalMotion(dynamics.modes, period_ns, s_to_ns(dynamics.delay_s), position)


def _convergence(model: StageModel, period_ns: int) -> Convergence | None:
    """Return the criterion of the paper; a model from a file or a fit counts as converged."""
    if np.any(model.weights):
        return None
    return Convergence(CONVERGED_WITHIN, window=_cycles(CONVERGED_FOR_S, period_ns))


def _adaptation(
    config: AxisConfig, form: ModelForm, weights: FloatArray, pace: float
) -> AdaptiveIdentifier:
    match form:
        case StopForm(bank):
            return _stop_adaptation(config, bank, weights, pace)
        case SurfaceForm():
            return _surface_adaptation(config, form, weights, pace)
    raise TypeError(f"no identifier for a {type(form).__name__}")


def _surface_adaptation(
    config: AxisConfig, form: SurfaceForm, weights: FloatArray, pace: float
) -> SurfaceIdentifier:
    settings = config.compensator
    if settings.identifier != "rls":
        raise ModelError(
            f"identifier {settings.identifier} learns the weights of stops, and the model is a "
            "surface: use `identifier: rls`"
        )
    # Its memory follows the drive, which has no noise of the sensor: it needs no dead-band.
    return SurfaceIdentifier(weights, form, pace=pace)


def _stop_adaptation(
    config: AxisConfig, bank: FloatArray, weights: FloatArray, pace: float
) -> AdaptiveIdentifier:
    settings = config.compensator
    deadband = settings.deadband_pct / 100.0
    # RLS has no gain to configure.
    if settings.identifier == "rls":
        # Of more frequent pairs, each has less information, and leaves less time for a change.
        return RLSIdentifier(
            bank,
            weights,
            weight_walk=covariance.WEIGHT_WALK * pace,
            offset_walk=covariance.OFFSET_WALK * pace,
            scale_walk=covariance.SCALE_WALK * pace,
            measurement_variance=covariance.MEASUREMENT_VARIANCE / pace,
            deadband=deadband,
        )
    if not has_even_thresholds(bank):
        # With thresholds close to 0, LMS amplifies the noise of the sensor and diverges.
        raise ModelError(
            f"identifier {settings.identifier} needs even thresholds, and the model has others: "
            "use `identifier: rls`, or identify the stage with `--thresholds even`"
        )
    kind = LMSIdentifier if settings.identifier == "lms" else NLMSIdentifier
    identifier = kind(bank, gain=settings.lms_gain * pace, deadband=deadband)
    identifier.adopt(weights)
    return identifier


def _pace(config: AxisConfig, form: ModelForm, period_ns: int) -> float:
    share = learned_share(config.compensator, form)
    return learning_pace(period_ns / NS_PER_S, config.first_mode, share)


def _learned_use(config: AxisConfig, form: ModelForm, period_ns: int) -> LearnedUse:
    unseen_lag_cycles = 0.0
    if config.compensator.sensor_delay_s and config.response is None:
        # Samples do not tell the lag of a stage that rings between them.
        shown = shown_share(period_ns / NS_PER_S, config.first_mode)
        unseen_lag_cycles = UNSEEN_LAG_CYCLES * (1.0 - shown)
    return LearnedUse(
        _cycles(PROOF_WINDOW_S, period_ns),
        learned_share(config.compensator, form) * _pace(config, form, period_ns),
        unseen_lag_cycles,
    )


def _proof(model: StageModel, period_ns: int, use: LearnedUse) -> ModelProof:
    return ModelProof(
        LearnedModel(model.weights.copy()),
        window_cycles=_cycles(PROOF_WINDOW_S, period_ns),
        lag_cycles=abs(s_to_ns(model.delay_s)) // period_ns + LAG_CYCLES,
        use=use,
    )


def _bound(
    config: AxisConfig, model: StageModel, adaptation: AdaptiveIdentifier, period_ns: int
) -> LearnedBound | None:
    """Return the bound of what is learned; without an identified model there is none."""
    if not np.any(model.weights):
        return None
    return LearnedBound(model, adaptation, config.compensator.learned_pct / 100.0, period_ns)


def _feedback(mode: Mode, config: AxisConfig, model: StageModel, period_ns: int) -> Trim:
    period_s, refusal = period_ns / NS_PER_S, ""
    try:
        check_feedback(mode, config, period_s, model.delay_s)
    except ModelError as error:
        refusal = str(error)
    law = feedback_law(mode, config, period_s, model.delay_s)
    authority_pct = (config.closed if mode is Mode.CLOSED else config.trim).authority_pct
    # The larger authority fades at the same rate, not within the same time.
    larger = max(authority_pct / config.trim.authority_pct, 1.0)
    fade_cycles = _cycles(larger * FADE_S, period_ns)
    settings = law.gain_per_s, period_s, authority_pct / 100.0, fade_cycles, refusal
    if law.proportional or law.notches:
        notches = [notch(each, period_s) for each in law.notches]
        return NotchedTrim(*settings, proportional=law.proportional, notches=notches)
    return Trim(*settings)


def _cycles(duration_s: float, period_ns: int) -> int:
    return max(1, s_to_ns(duration_s) // period_ns)
