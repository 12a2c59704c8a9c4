"""Response files: written and read without loss, refused if invalid, and used by an axis."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from pydantic import BaseModel

from piezod.config.experiment import ExperimentConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.response_file import (
    GainConfig,
    ResonanceConfig,
    ResponseFile,
    dump_response,
    load_response,
)
from piezod.control.law.response_files import response_model
from piezod.dynamics import Resonance
from piezod.errors import ConfigError
from piezod_drivers.simulated.options import SimulatedOptions

FILTER: Final = ResonanceConfig(frequency_hz=450.0, damping=0.7, share=1.3)
MODE: Final = ResonanceConfig(
    frequency_hz=800.0 + 1 / 3, damping=0.03, share=-0.3, frequency_uncertainty_hz=0.1
)
RESPONSE: Final = ResponseFile(
    created_at="2024-05-01T12:00:00+00:00",
    created_by="piezod 0.1.0",
    method="multisine",
    rate_hz=10_000.0,
    low_hz=5.0,
    high_hz=4000.0,
    coherence_low=0.9,
    coherence_high=1.0,
    gains=(GainConfig(offset_v=75.0, amplitude_v=2.0, um_per_v=0.15),),
    delay_s=1.2e-5,
    resonances=(FILTER, MODE),
)
TEXT: Final = dump_response(RESPONSE)
RANGE: Final = "    command_range_um: [0, 26]"
PAGE: Final = (Path(__file__).parents[2] / "docs" / "response.md").read_text(encoding="utf-8")
Load = Callable[..., ExperimentConfig]


def test_round_trip(tmp_path: Path) -> None:
    """A written response is read back to the last bit."""
    path = tmp_path / "r.yaml"
    path.write_text(TEXT, encoding="utf-8")

    assert load_response(path) == RESPONSE


def test_shipped_response_is_that_of_the_simulated_stage() -> None:
    """It was measured on a running stage, and has the mode of its specimen within 1 %."""
    shipped = load_response(Path(__file__).parents[2] / "config/responses/simulated-stack.yaml")
    seed = np.random.SeedSequence(1).spawn(1)[0].spawn(3)[0]
    true = SimulatedOptions.model_validate({"variant": "stack"}).plant(seed).stage

    assert shipped.first_mode is not None
    assert shipped.first_mode.frequency_hz == pytest.approx(true.mode_hz, rel=0.01)
    assert shipped.first_mode.damping == pytest.approx(true.mode_damping, rel=0.1)


@pytest.mark.parametrize("model", [ResponseFile, ResonanceConfig, GainConfig])
def test_page_names_every_key(model: type[BaseModel]) -> None:
    """The page about responses contains every key."""
    assert [key for key in model.model_fields if f"`{key}`" not in PAGE] == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("share: -0.3", "share: -0.2", "resonances: the shares must add up to 1 (got 1.1)"),
        ("frequency_hz: 450.0", "frequency_hz: 900.0",
         "resonances[1].frequency_hz: must be above that of the resonance before it (got 800.333)"),
        ("damping: 0.7", "damping: 1.5", "out of range (got 1.5), allowed range 0.001 to 1"),
        ("high_hz: 4000.0", "high_hz: 1.0", "high_hz: must be at least low_hz, 5 (got 1)"),
        ("delay_s: 1.2e-05", "delay_s: -1", "delay_s: out of range (got -1), allowed range 0 to 1"),
    ],
)  # fmt: skip
def test_one_mistake(tmp_path: Path, old: str, new: str, expected: str) -> None:
    """Each mistake gives one line with the place and the allowed values."""
    assert TEXT.count(old) == 1
    path = tmp_path / "r.yaml"
    path.write_text(TEXT.replace(old, new), encoding="utf-8")

    with pytest.raises(ConfigError) as caught:
        load_response(path)

    (problem,) = map(str, caught.value.problems)
    assert problem.startswith(f"{path}:")
    assert expected in problem


def with_response(load: Load, tmp_path: Path, more: str = "", text: str = TEXT) -> ExperimentConfig:
    """Return a configuration whose axis has a response."""
    (tmp_path / "r.yaml").write_text(text, encoding="utf-8")
    return load((RANGE, f"{RANGE}\n    response: {tmp_path / 'r.yaml'}{more}"))


def test_first_mode_is_that_of_the_response(load: Load, tmp_path: Path) -> None:
    """A filter is no mode, and `first_mode` of the axis comes first."""
    axis = with_response(load, tmp_path).axes["x"]
    given = "\n    first_mode: {frequency_hz: 734, damping: 0.015}"
    axis_with_mode = with_response(load, tmp_path, given).axes["x"]

    assert axis.response == RESPONSE
    assert axis.first_mode == FirstModeConfig(frequency_hz=MODE.frequency_hz, damping=0.03)
    assert axis_with_mode.first_mode == FirstModeConfig(frequency_hz=734.0, damping=0.015)


def test_a_copy_of_the_configuration_holds_the_response(load: Load, tmp_path: Path) -> None:
    """The file is not needed again, and a derived `first_mode` is not written down."""
    axis = with_response(load, tmp_path).axes["x"]
    written = axis.model_dump(exclude_unset=True)

    assert ResponseFile.model_validate(written["response"]) == RESPONSE
    assert "first_mode" not in written


def test_problem_of_the_file_has_its_place(
    problems_of: Callable[..., list[str]], tmp_path: Path
) -> None:
    """The line in the configuration and the line in the response file are both reported."""
    file = tmp_path / "r.yaml"
    file.write_text(TEXT.replace("rate_hz: 10000.0", "rate_hz: fast"), encoding="utf-8")

    (problem,) = problems_of((RANGE, f"{RANGE}\n    response: {file}"))
    (absent,) = problems_of((RANGE, f"{RANGE}\n    response: none.yaml"))

    assert problem.startswith(f"test.yaml:12:15: axes.x.response: {file}:7:10: rate_hz: must be")
    assert "axes.x.response: no such file" in absent


def test_model_of_a_file_has_its_delay_and_resonances() -> None:
    """The delay of the file has no hold, and the model adds none."""
    model = response_model(RESPONSE)

    assert model.delay_s == RESPONSE.delay_s
    assert model.resonances == (
        Resonance(450.0, 0.7, 1.3),
        Resonance(MODE.frequency_hz, 0.03, -0.3),
    )
