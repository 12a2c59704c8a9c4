"""The page about experiment files agrees with the models."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, get_args

import pytest
from pydantic import BaseModel

from piezod.config.axes import CompensatorConfig, LimitsConfig
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import Metric
from piezod.config.first_mode import FirstModeConfig
from piezod.config.modes import Mode
from piezod.config.response_file import ResponseFile
from piezod.config.trim import ClosedConfig, TrimConfig

PAGE: Final = (Path(__file__).parents[2] / "docs" / "experiments.md").read_text(encoding="utf-8")
# Words in code spans, in the text or in an example: `high`, `{kind: modulated, depth: 0.8}`.
SPANS: Final = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL))
WORDS: Final = set(re.findall(r"[a-z][a-z_-]*", " ".join(SPANS)))
UNITS: Final = {
    "_v_per_s": "V/s",
    "_per_s": "1/s",
    "_v": "V",
    "_hz": "Hz",
    "_pct": "% of range",
    "_s": "s",
    "": "–",
}


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models of a type, and those of their fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation is ResponseFile:  # a file with a page of its own
            return
        yield annotation
        for field in annotation.model_fields.values():
            yield from models_in(field.annotation)
    for part in get_args(annotation):
        yield from models_in(part)


MODELS: Final = sorted(set(models_in(ExperimentConfig)) - {BaseModel}, key=lambda m: m.__name__)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_page_names_every_key(model: type[BaseModel]) -> None:
    """The page contains every key."""
    assert set(model.model_fields) - WORDS == set()


def test_page_names_every_model() -> None:
    """The search above reaches the models inside unions, lists and mappings."""
    names = {model.__name__ for model in MODELS}

    assert {"CompensatorConfig", "Component", "DecayingEnvelope", "SequencePart"} <= names


def test_page_names_every_mode_and_metric() -> None:
    """All allowed words of lists are on the page."""
    assert {*Mode, *get_args(Metric)} <= WORDS


@pytest.mark.parametrize(
    ("model", "prefix"),
    [
        (LimitsConfig, ""),
        (FirstModeConfig, ""),
        (CompensatorConfig, ""),
        (TrimConfig, ""),
        (ClosedConfig, "closed."),
    ],
)
def test_page_has_ranges_units_and_defaults(model: type[BaseModel], prefix: str) -> None:
    """The tables of numbers of an axis agree with the models."""
    properties = model.model_json_schema()["properties"]
    for name, field in model.model_fields.items():
        (row,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{prefix}{name}` | "))
        cells = [cell.strip() for cell in row.strip("|").split("|")]

        assert cells[2] == range_of(properties[name])
        assert cells[1] == next(unit for end, unit in UNITS.items() if name.endswith(end))
        assert field.is_required() or cells[3] == shown(field.default)


def range_of(schema: dict[str, Any]) -> str:
    """Return the range of a field's number, or its allowed words."""
    if schema.get("type") == "boolean":
        return "`false`, `true`"
    if "enum" in schema:
        return ", ".join(f"`{word}`" for word in schema["enum"])
    choices = schema.get("oneOf", schema.get("anyOf", [schema]))
    number = next(one for one in choices if "minimum" in one)
    return f"{number['minimum']:.12g} to {number['maximum']:.12g}"


def shown(default: object) -> str:
    """Return a default as the page shows it."""
    if default is None:
        return "–"
    if isinstance(default, bool):
        return str(default).lower()
    return f"{default:g}" if isinstance(default, float) else str(default)
