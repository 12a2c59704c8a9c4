"""A valid experiment file, to be changed in one place, and a registry of fake drivers."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import pytest
from pydantic import BaseModel, Field

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.fields import ConfigModel
from piezod.errors import ConfigError, RegistryError

EXPERIMENT = """\
rate_hz: 1000
devices:
  rig:
    driver: bench
    options: {variant: stack, gain: 2.5}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
    compensator: {operators: 19, lms_gain: 0.1}
identification:
  method: least-squares
  settle_s: 5
  duration_s: 30
  drive_v: {kind: sine, low: 0, high: 148, frequency_hz: 0.4}
modes: [feedforward, adaptive]
cases:
  - name: case 1
    period_s: 2
    duration_s: 20
    command_um: {kind: triangle, low: 0, high: 25, frequency_hz: 0.5}
"""


class BenchOptions(ConfigModel):
    """Options of a driver, based on the configuration's model."""

    variant: Literal["stack", "flexure"] = "stack"
    gain: Annotated[float, Field(gt=0, le=10)] = 1.0


class PortOptions(BaseModel):
    """Options of a driver, based on a model of another kind."""

    model_config = {"extra": "forbid", "strict": True}

    port: str
    baud_rate: int = Field(default=9600, ge=300, lt=1_000_000)
    verbose: bool = False


def any_channel(_options: object) -> None:
    """Accept any channel name."""


class _Plugin(NamedTuple):
    options_model: type[BaseModel]
    channels: Callable[[Any], None] = any_channel


_PLUGINS = {"bench": _Plugin(BenchOptions), "port": _Plugin(PortOptions)}


class FakeDrivers:
    """A registry with three drivers, one of which cannot be imported."""

    def names(self) -> tuple[str, ...]:
        """Return the names."""
        return "bench", "port", "broken"

    def load(self, name: str) -> _Plugin:
        """Return the plug-in."""
        if name == "broken":
            raise RegistryError("driver 'broken' cannot be imported: no module named 'acme'")
        return _PLUGINS[name]


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., ExperimentConfig]:
    """Return a function that loads the experiment after replacing parts of its text."""

    def spoil_and_load(*replacements: tuple[str, str]) -> ExperimentConfig:
        text = EXPERIMENT
        for old, new in replacements:
            assert text.count(old) == 1, f"{old!r} must be there once"
            text = text.replace(old, new)
        path = tmp_path / "test.yaml"
        path.write_text(text, encoding="utf-8")
        return load_experiment(path, FakeDrivers())

    return spoil_and_load


@pytest.fixture
def problems_of(load: Callable[..., ExperimentConfig]) -> Callable[..., list[str]]:
    """Return a function that returns the problems of the changed experiment, without the folder."""

    def spoil(*replacements: tuple[str, str]) -> list[str]:
        with pytest.raises(ConfigError) as caught:
            load(*replacements)
        return [
            str(problem).replace(problem.file, "test.yaml") for problem in caught.value.problems
        ]

    return spoil
