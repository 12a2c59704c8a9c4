"""The page about running a stage agrees with the models of the configuration."""

import re
from pathlib import Path
from typing import Final

import pytest
from pydantic import BaseModel

from piezod.config.axes import AxisConfig
from piezod.config.daemon import (
    ConditioningConfig,
    DaemonConfig,
    LoopConfig,
    OnTargetConfig,
    RecordingsConfig,
    SafetyConfig,
    StageAxisConfig,
)

PAGE: Final = (Path(__file__).parents[2] / "docs" / "stage.md").read_text(encoding="utf-8")
OWN: Final = (
    DaemonConfig,
    StageAxisConfig,
    OnTargetConfig,
    ConditioningConfig,
    SafetyConfig,
    LoopConfig,
    RecordingsConfig,
    AxisConfig,
)


@pytest.mark.parametrize("model", OWN)
def test_page_names_every_key(model: type[BaseModel]) -> None:
    """The page contains every key."""
    assert [key for key in model.model_fields if f"`{key}`" not in PAGE] == []


@pytest.mark.parametrize("model", [OnTargetConfig, ConditioningConfig, SafetyConfig, LoopConfig])
def test_page_has_the_defaults(model: type[BaseModel]) -> None:
    """Each default is near its key."""
    for key, field in model.model_fields.items():
        if isinstance(field.default, bool) or field.default is None:
            continue
        after = PAGE[PAGE.index(f"`{key}`") :]
        shown = f"{field.default:g}" if isinstance(field.default, float) else str(field.default)

        assert re.search(rf"\b{re.escape(shown)}\b", after[:220]), key
