"""Refuses gains that are not safe, as soon as the properties that decide about them are known."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from piezod.config.axes import AxisConfig
from piezod.config.modes import CORRECTED, Mode
from piezod.control.law.compensated import check_identifier, in_loop
from piezod.control.law.model import unidentified_form, with_found_mode
from piezod.control.law.model_files import read_model
from piezod.control.law.trim_gains import check_feedback
from piezod.errors import DataError, ModelError
from piezod.hysteresis import ModelForm


def check_gains(axes: Mapping[str, AxisConfig], period_s: float, modes: Collection[Mode]) -> None:
    """Check the gains of all axes, as far as possible before anything moves.

    The delay is in the model file, or in the configuration. Without either, a feedback is checked
    later, and so is `closed` while an identification may still find the first mode.

    Args:
        axes: The axes, by name.
        period_s: Period of the loop, in s.
        modes: The modes that are used.

    Raises:
        ConfigError: If a model file cannot be used.
        ModelError: If the gain of an identifier or of a feedback is not safe; the text names the
            axis.
    """
    for name, axis in axes.items():
        if axis.model is not None:
            model = in_loop(axis, read_model(axis.model)[0], None, period_s)
            properties = LoopProperties(model.form, model.delay_s, period_s)
            check_axis_gains(name, with_found_mode(axis, model), properties, modes)
            continue
        delay_s = axis.compensator.delay_s
        configured_s = None if delay_s == "auto" else delay_s
        properties = LoopProperties(unidentified_form(axis), configured_s, period_s)
        known = axis.response is not None or axis.first_mode is not None
        check_axis_gains(
            name, axis, properties, [each for each in modes if known or each is not Mode.CLOSED]
        )


class LoopProperties(NamedTuple):
    """Properties that decide which gains of an axis are safe."""

    form: ModelForm  #: Form of its model.
    delay_s: float | None  #: Delay from drive to sensor, in s; None while it is unknown.
    period_s: float  #: Period of the loop, in s.


def check_axis_gains(
    name: str, axis: AxisConfig, properties: LoopProperties, modes: Collection[Mode]
) -> None:
    """Check the gains of an axis.

    Args:
        name: Name of the axis.
        axis: Configuration of the axis.
        properties: Properties of its loop.
        modes: The modes that are used; of the others any gain is allowed.

    Raises:
        ModelError: If a gain is not safe; the text names the axis.
    """
    with prefix_errors(name):
        check_identifier(axis, properties.form)
        if properties.delay_s is None and axis.response is None:
            return
        for mode in CORRECTED:
            if mode in modes:
                check_feedback(mode, axis, properties.period_s, properties.delay_s or 0.0)


@contextmanager
def prefix_errors(axis: str) -> Iterator[None]:
    """Put the name of the axis before the text of an error."""
    try:
        yield
    except (DataError, ModelError) as error:
        raise type(error)(f"axis {axis}: {error}") from error
