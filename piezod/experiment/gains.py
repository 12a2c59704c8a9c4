"""Gains that are not safe are refused as soon as what decides about them is known."""

from collections.abc import Iterator
from contextlib import contextmanager

from piezod.config.experiment import ExperimentConfig
from piezod.config.modes import Mode
from piezod.errors import DataError, ModelError
from piezod.experiment.compensated import check_identifier, check_trim
from piezod.experiment.model_io import read_model
from piezod.hysteresis import even_thresholds, new_bank
from piezod.hysteresis.memory import FloatArray


def check_known(config: ExperimentConfig) -> None:
    """Check the gains of all axes, as far as that can be done before anything moves.

    A model file tells the delay, and so may the configuration; else the trim has to wait.

    Raises:
        ConfigError: If a model file cannot be used.
        ModelError: If a gain of an identifier or of a trim is not safe; the text names the axis.
    """
    for name, axis in config.axes.items():
        if axis.model is not None:
            model, _ = read_model(axis.model)
            check_axis(name, config, model.bank, model.delay_s)
            continue
        thresholds = even_thresholds(axis.compensator.operators)
        delay_s = axis.compensator.delay_s
        known_s = None if delay_s == "auto" else delay_s
        check_axis(name, config, new_bank(thresholds, thresholds), known_s)


def check_axis(
    name: str, config: ExperimentConfig, bank: FloatArray, delay_s: float | None
) -> None:
    """Check the gains of an axis.

    Args:
        name: Name of the axis.
        config: The experiment; a trim counts only where one of its modes is `trimmed`.
        bank: Thresholds of the axis' model, shape (2, 2 M).
        delay_s: Delay from drive to sensor, in s; None while it is not known.

    Raises:
        ModelError: If one is not safe; the text names the axis.
    """
    axis = config.axes[name]
    with naming(name):
        check_identifier(axis, bank)
        if delay_s is not None and Mode.TRIMMED in config.modes:
            check_trim(axis, 1.0 / config.rate_hz, delay_s)


@contextmanager
def naming(axis: str) -> Iterator[None]:
    """Put the name of the axis before what an error says."""
    try:
        yield
    except (DataError, ModelError) as error:
        raise type(error)(f"axis {axis}: {error}") from error
