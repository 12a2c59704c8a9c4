"""Errors of the models of drivers: other kinds of fields, nested in other ways."""

from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import pytest
from pydantic import BaseModel, Field, field_validator, model_validator

from piezod.config.fields import ConfigModel, Context
from piezod.config.messages import describe, show
from piezod.config.validate import validate
from piezod.config.waveforms.paths import Csv
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import ConfigError


class Line(ConfigModel):
    """A member of a union with another discriminator than `kind`."""

    shape: Literal["line"]
    slope: Annotated[float, Field(lt=3)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.slope == 0:
            raise ValueError("a line without slope is of no use")
        return self


class Table(ConfigModel):
    """The other member."""

    shape: Literal["table"]
    points: tuple[float, ...] = Field(max_length=2)


class Foreign(BaseModel):
    """A model that is not based on piezod's."""

    model_config = {"extra": "forbid"}

    port: str = ""


class Options(ConfigModel):
    """Options with one field of each kind."""

    curve: Annotated[Line | Table, Field(discriminator="shape")] | None = None
    label: str = Field(default="", max_length=3)
    when: date | None = None
    even: int = 0
    odd: int = 1
    foreign: Foreign = Foreign()

    @field_validator("odd")
    @classmethod
    def _check_odd(cls, number: int) -> int:
        if number % 2 == 0:
            raise AssertionError("must be odd")
        return number

    @field_validator("even")
    @classmethod
    def _check_even(cls, number: int) -> int:
        if number % 2:
            raise ValueError("must be even")
        return number


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("curve: {shape: lin}", "1:16: curve.shape: unknown value (got 'lin'), "
         "did you mean 'line'?"),
        ("curve: {slope: 1}", "1:1: curve: required key 'shape' is missing"),
        ("curve: {shape: line}", "1:1: curve.slope: required key is missing"),
        ("curve: {shape: line, slope: 3}", "1:29: curve.slope: too large (got 3), "
         "allowed: less than 3.0"),
        ("curve: {shape: line, slope: 0}", "1:1: curve: a line without slope is of no use "
         "(got a mapping)"),
        ("curve: {shape: table, points: [1, 2, 3]}", "1:31: curve.points: too many entries "
         "(got 3), allowed: at most 2"),
        ("curve: {shape: table, points: [1, x]}", "1:35: curve.points[1]: must be a number "
         "(got 'x')"),
        ("curve: {shape: table, points: {}}", "1:23: curve.points: must be a list "
         "(got a mapping)"),
        ("label: long", "1:8: label: too long (got 'long'), allowed: at most 3 characters"),
        ("odd: 2", "1:6: odd: must be odd (got 2)"),
        ("even: 3", "1:7: even: must be even (got 3)"),
        ("when: 2024-01-01", "1:7: when: must be a valid date (got '2024-01-01')"),
        ("foreign: {prot: x}", "1:11: foreign.prot: unknown key"),
    ],
)  # fmt: skip
def test_one_mistake(text: str, expected: str) -> None:
    """For any kind of field, the line states place and reason."""
    with pytest.raises(ConfigError) as caught:
        validate(parse_yaml(text, "f.yaml"), Options, Context())
    assert str(caught.value) == f"f.yaml:{expected}"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "nothing"),
        (False, "false"),
        (float("-inf"), "-.inf"),
        (float("nan"), ".nan"),
        (2.5, "2.5"),
        ("a\nb", "'a\\nb'"),
        ((1, 2), "a list"),
        ({}, "a mapping"),
        ("x" * 50, "'" + "x" * 39 + "…"),
    ],
)
def test_values_are_shown_as_in_a_file(value: object, text: str) -> None:
    """A found value is shown on one line and shortened."""
    assert show(value) == text


def test_paths_made_in_python(tmp_path: Path) -> None:
    """In Python a file may be given as a path."""
    path = tmp_path / "w.csv"
    path.write_text("t_s,drive_v\n0,1\n")

    assert Csv(kind="csv", path=path, column="drive_v").bounds() == (1.0, 1.0)


@pytest.mark.parametrize("text", ["200 Hz", "5um", "-1.5e3 µm/s"])
def test_number_with_its_unit_is_told_so(text: str) -> None:
    """The unit is in the name of the key or of the argument."""
    error: Any = {"type": "float_parsing", "input": text, "loc": ("x",), "msg": ""}

    assert describe(error, ()).startswith("must be a number without its unit")
    error["input"] = "fast"
    assert "unit" not in describe(error, ())
