"""Gains that are not safe are refused as soon as what decides about them is known."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from piezod.config.axes import AxisConfig
from piezod.control.law.compensated import check_identifier, check_trim
from piezod.control.law.model_files import read_model
from piezod.errors import DataError, ModelError
from piezod.hysteresis import even_thresholds, new_bank
from piezod.hysteresis.memory import FloatArray


def check_known(axes: Mapping[str, AxisConfig], period_s: float, *, trimmed: bool) -> None:
    """Check the gains of all axes, as far as that can be done before anything moves.

    A model file tells the delay, and so may the configuration; else the trim has to wait.

    Args:
        axes: The axes, by name.
        period_s: Period of the loop, in s.
        trimmed: Whether mode `trimmed` is used.

    Raises:
        ConfigError: If a model file cannot be used.
        ModelError: If a gain of an identifier or of a trim is not safe; the text names the axis.
    """
    for name, axis in axes.items():
        if axis.model is not None:
            model, _ = read_model(axis.model)
            known = Known(model.bank, model.delay_s, period_s)
            check_axis(name, axis, known, trimmed=trimmed)
            continue
        thresholds = even_thresholds(axis.compensator.operators)
        delay_s = axis.compensator.delay_s
        known_s = None if delay_s == "auto" else delay_s
        known = Known(new_bank(thresholds, thresholds), known_s, period_s)
        check_axis(name, axis, known, trimmed=trimmed)


class Known(NamedTuple):
    """What decides which gains of an axis are safe.

    Attributes:
        bank: Thresholds of its model, shape (2, 2 M).
        delay_s: Delay from drive to sensor, in s; None while it is not known.
        period_s: Period of the loop, in s.
    """

    bank: FloatArray
    delay_s: float | None
    period_s: float


def check_axis(name: str, axis: AxisConfig, known: Known, *, trimmed: bool) -> None:
    """Check the gains of an axis.

    Args:
        name: Its name.
        axis: Its configuration.
        known: Its model's thresholds, its delay, the period.
        trimmed: Whether mode `trimmed` is used; a trim does not count where it is not.

    Raises:
        ModelError: If one is not safe; the text names the axis.
    """
    with naming(name):
        check_identifier(axis, known.bank)
        if known.delay_s is not None and trimmed:
            check_trim(axis, known.period_s, known.delay_s)


@contextmanager
def naming(axis: str) -> Iterator[None]:
    """Put the name of the axis before what an error says."""
    try:
        yield
    except (DataError, ModelError) as error:
        raise type(error)(f"axis {axis}: {error}") from error
