"""Random waveforms of every kind, drawn from the fields of the kinds and their ranges."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import mkdtemp
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from hypothesis import strategies as st
from pydantic import BaseModel, TypeAdapter, ValidationError

from piezod.config.fields import Quantity
from piezod.config.waveforms.combined import KINDS, WaveformConfig

READER: Final[TypeAdapter[WaveformConfig]] = TypeAdapter(WaveformConfig)
USUAL: Final = {"Hz": (0.01, 50.0), "s": (0.1, 10.0), "per s": (0.1, 20.0)}
"""Usual values by unit: in the whole range most waveforms would be slower or faster than a test."""
ORDERED: Final = {"low": "high", "min_speed": "max_speed"}
"""Fields of which the second one is the larger one."""
TABLE: Final = Path(mkdtemp()) / "wave.csv"
TABLE.write_text("t_s,v\n0.5,2\n1,-3\n4,7\n", encoding="utf-8")

FIXED: Final[dict[type, object]] = {str: "v", Path: TABLE}
"""Values of fields that are no numbers."""


def waveforms(*models: type[BaseModel]) -> st.SearchStrategy[dict[str, Any]]:
    """Return the keys of valid waveforms of these kinds; without any, of every kind."""
    return st.one_of(*map(_fields, models or KINDS.values())).filter(_valid)


def quantities(model: BaseModel, unit: str) -> Iterator[float]:
    """Yield all numbers of a unit in a model and its parts."""
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if unit in [each.unit for each in field.metadata if isinstance(each, Quantity)]:
            yield value
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, BaseModel):
                yield from quantities(part, unit)


def _valid(keys: dict[str, Any]) -> bool:
    try:
        READER.validate_python(keys)
    except ValidationError:
        return False
    return True


def _fields(model: type[BaseModel]) -> st.SearchStrategy[dict[str, Any]]:
    fields = model.model_fields.items()
    drawn = {name: _of(each.annotation, *each.metadata) for name, each in fields}
    return st.fixed_dictionaries(drawn).map(_ordered)


def _ordered(keys: dict[str, Any]) -> dict[str, Any]:
    for smaller, larger in ORDERED.items():
        if {smaller, larger} <= keys.keys():
            keys[smaller], keys[larger] = sorted((keys[smaller], keys[larger]))
    if "points" in keys:
        keys["points"] = tuple(sorted(dict(keys["points"]).items()))
    return keys


def _of(annotation: Any, *metadata: Any) -> st.SearchStrategy[Any]:
    """Return values of a type."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    drawn: st.SearchStrategy[Any]
    if origin is Annotated:
        drawn = _of(arguments[0], *arguments[1:])
    elif origin is Literal:
        drawn = st.sampled_from(arguments)
    elif origin in {Union, UnionType}:
        drawn = st.one_of(*map(_of, arguments))
    elif origin is tuple and arguments[-1] is Ellipsis:
        least = max((getattr(each, "min_length", None) or 0 for each in metadata), default=0)
        drawn = st.lists(_of(arguments[0]), min_size=least, max_size=least + 4).map(tuple)
    elif origin is tuple:
        drawn = st.tuples(*map(_of, arguments))
    elif annotation in FIXED:
        drawn = st.just(FIXED[annotation])
    elif issubclass(annotation, BaseModel):
        drawn = _fields(annotation)
    else:
        (allowed,) = (each for each in metadata if isinstance(each, Quantity))
        drawn = _number(annotation, allowed)
    return drawn


def _number(annotation: type, allowed: Quantity) -> st.SearchStrategy[float]:
    if annotation is int:
        return st.integers(int(allowed.low), int(allowed.high))
    low, high = USUAL.get(allowed.unit, (0.1, 1.0) if allowed.low > 0 else (-100.0, 100.0))
    return st.floats(max(low, allowed.low), min(high, allowed.high))
