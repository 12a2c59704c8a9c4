"""Builds a stage from its configuration, ready for the loop."""

from collections.abc import Callable, Sequence

import numpy as np

from piezod.config.daemon import DaemonConfig, StageAxisConfig
from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.control.controller import StageController
from piezod.control.faults.register import FaultRegister
from piezod.control.law.compensated import Start, compensated_axis, in_loop
from piezod.control.law.gains import check_gains, prefix_errors
from piezod.control.law.model import StageModel, unidentified_form, with_found_mode
from piezod.control.law.model_files import from_model_file, read_model
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.boundary import DeviceBoundary, StageDevices
from piezod.control.stage.lines import StageLines
from piezod.control.stage.motion_limits import allowed_range_um, range_beyond_reach
from piezod.control.stage.parts import StageParts, WatchedAxis
from piezod.control.stage.playing import PlayRunner
from piezod.control.stage.stage import Stage
from piezod.control.stage.user_axes import UserAxes
from piezod.control.watch.absent_sensor import AbsentSensor
from piezod.control.watch.adaptation import AdaptationWatch
from piezod.control.watch.amplifier import AmplifierWatch
from piezod.control.watch.axis import AxisWatch
from piezod.control.watch.bus import BusWatch
from piezod.control.watch.loop import LoopWatch
from piezod.control.watch.sensor import SensorWatch, WatchedSensor
from piezod.devices.interface import Capabilities
from piezod.devices.line_levels import LineLevels
from piezod.devices.wiring import pairs_of
from piezod.errors import ModelError
from piezod.hysteresis import AffineRange
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, s_to_ns


def check_stage(config: DaemonConfig) -> None:
    """Refuse gains that are not safe, before any device is opened.

    A feedback that is not in use does not stop a stage, which refuses its mode.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If a model does not hold at the rest voltage.
        ModelError: If a gain of an identifier or of a trim is not safe; the text names the axis.
    """
    check_gains(config.axes, 1.0 / config.rate_hz, (config.mode,))
    for name, axis in config.axes.items():
        model = _model_of(name, axis)
        with prefix_errors(name):
            allowed_range_um(axis, model)


def stage_warnings(config: DaemonConfig) -> tuple[str, ...]:
    """Return what of a configuration that `check_stage` has accepted does not fit together."""
    beyond = {
        name: range_beyond_reach(axis, _model_of(name, axis)) for name, axis in config.axes.items()
    }
    return tuple(f"axis {name}: {what}" for name, what in beyond.items() if what)


def assemble(
    config: DaemonConfig,
    devices: StageDevices,
    capabilities: Capabilities,
    on_output_lost: Callable[[], None] | None = None,
    plays: PlayRunner | None = None,
    levels: LineLevels | None = None,
) -> StageController:
    """Return the controller of a stage; arguments and errors are those of `make_stage`."""
    stage = make_stage(config, devices, capabilities, on_output_lost, plays, levels)
    return StageController(stage, LoopWatch(stage.period_ns, strict=config.loop.strict_rt))


def make_stage(
    config: DaemonConfig,
    devices: StageDevices,
    capabilities: Capabilities,
    on_output_lost: Callable[[], None] | None = None,
    plays: PlayRunner | None = None,
    levels: LineLevels | None = None,
) -> Stage:
    """Build a stage; its devices are open and active.

    Args:
        config: Configuration that `check_stage` has accepted.
        devices: The devices as one, with the axes of the configuration, in its order.
        capabilities: Capabilities of the devices together.
        on_output_lost: Called when the voltage in force can no longer be derived from the last
            write.
        plays: Runs the plays of the devices; None if no device can play.
        levels: Levels of the lines of the configuration; None for a stage without lines.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If a model does not hold at the rest voltage.
        ModelError: If a gain is not safe.
    """
    period_ns, lag_ns = round(NS_PER_S / config.rate_hz), capabilities.lag_ns

    def rebuild(name: str, model: ModelFile, in_force_v: float) -> WatchedAxis:
        axis = config.axes[name]
        if misfit := next(axis.misfits(model.span), ""):
            raise ModelError(f"axis {name}: the model {misfit}")
        zeroed = _zeroed(name, axis, from_model_file(model))
        return _build_axis(config, name, zeroed, in_force_v, lag_ns)

    axes = {
        name: _build_axis(config, name, _model_of(name, axis), axis.limits.rest_v, lag_ns)
        for name, axis in config.axes.items()
    }
    boundary = DeviceBoundary(
        devices,
        len(axes),
        reads_back=devices.reads_back(),
        holds=capabilities.holds,
        reports_restart=capabilities.tells_restart,
        watchdog=devices.watchdogs(),
        lag_cycles=-(-lag_ns // period_ns),
        amplifiers=[pair.amplifier for pair in pairs_of(config.axes).values()],
    )
    lines = StageLines(config.lines, levels, period_ns) if levels and config.lines else None
    register = FaultRegister(reset_after_cycles=NS_PER_S // period_ns)
    stage = Stage(
        StageParts(axes, boundary, period_ns, rebuild, plays, lines, _user_axes(config, period_ns)),
        register,
        # No stage is relaxed by itself inside its range.
        memory_known=capabilities.opens_relaxed
        and not any(watched.axis.law.rests_inside for watched in axes.values()),
        on_output_lost=on_output_lost,
    )
    for text in stage_warnings(config):
        stage.note(StageEvent(0, "warning", "range", text))
    return stage


def _user_axes(
    config: DaemonConfig, period_ns: int
) -> Callable[[Sequence[StageAxis]], UserAxes] | None:
    transform = config.transform
    return None if transform is None else lambda axes: UserAxes(transform, axes, period_ns)


def _model_of(name: str, axis: StageAxisConfig) -> StageModel | None:
    """Return the model of an axis; None if it is not yet identified."""
    return None if axis.model is None else _zeroed(name, axis, read_model(axis.model)[0])


def _zeroed(name: str, axis: StageAxisConfig, model: StageModel) -> StageModel:
    with prefix_errors(name):
        return model.zeroed_at(axis.limits.rest_v)


def _proportional_model(axis: StageAxisConfig) -> StageModel:
    """Return a model without compensation, for an axis that is not yet identified.

    It maps the range of the commands to the range of the drive in proportion.
    """
    low_um, high_um = axis.command_range_um or (0.0, 1.0)
    form = unidentified_form(axis)
    delay_s = axis.compensator.delay_s
    return StageModel(
        form=form,
        weights=np.zeros(form.size),
        drive_v=AffineRange(axis.limits.drive_min_v, axis.limits.drive_max_v),
        position_um=AffineRange(low_um, high_um),
        delay_s=0.0 if delay_s == "auto" else delay_s,
    )


def _build_axis(
    config: DaemonConfig, name: str, model: StageModel | None, in_force_v: float, lag_ns: int
) -> WatchedAxis:
    """Return an axis and its watches."""
    period_ns = round(NS_PER_S / config.rate_hz)
    axis = with_found_mode(config.axes[name], model)
    model = model and in_loop(axis, model, None, period_ns / NS_PER_S)
    law_model = model or _proportional_model(axis)
    mode = config.mode if model else Mode.UNCOMPENSATED
    creep = law_model.at_rest(axis.limits.rest_v, period_ns / NS_PER_S)
    start = Start(0, period_ns, in_force_v)
    law = compensated_axis(
        axis, law_model, creep, mode, lambda _t_s: law_model.position_um.low, start
    )
    if refusal := law.refusal(mode):
        raise ModelError(f"axis {name}: {refusal}")
    delay_ns = max(s_to_ns(law_model.delay_s), 0)
    index = list(config.axes).index(name)
    adaptation = law.identifier.adaptation
    watches = AxisWatch(
        BusWatch(index),
        _sensor_watch(axis, model, index, period_ns),
        AmplifierWatch(index, law.limits, delay_ns, period_ns, lag_ns),
        AdaptationWatch(index, adaptation, law.proof, law.bound, law_model.position_um, period_ns),
    )
    with prefix_errors(name):
        range_um = allowed_range_um(axis, model)
    stage_axis = StageAxis(name, axis, law, period_ns, range_um)
    return WatchedAxis(stage_axis, watches)


def _sensor_watch(
    axis: StageAxisConfig, model: StageModel | None, index: int, period_ns: int
) -> SensorWatch | AbsentSensor:
    if axis.sensor is None:
        return AbsentSensor()
    return SensorWatch(index, WatchedSensor.of(axis, model), period_ns)
