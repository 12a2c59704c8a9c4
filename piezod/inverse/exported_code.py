"""A model as code: one file of C99 or MATLAB with the numbers of the model and a self-test.

The texts in the folders `c` and `matlab` are the same for every model, but for the names: `inverse`
becomes the name of the file. Before them stand the numbers of the model, behind them the voltages
of the self-test, which the compensator of the loop has computed.
"""

import re
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from importlib.resources import files
from itertools import chain, zip_longest
from math import isfinite
from pathlib import Path
from string import Template
from typing import Final, NamedTuple

import numpy as np

from piezod.config.fields import ConfigModel
from piezod.config.model_file import ModelFile
from piezod.control.law.creep import CreepState
from piezod.control.law.kernel import COMMAND, NEXT
from piezod.control.law.kernels import new_kernel
from piezod.control.law.model import StageModel
from piezod.errors import ModelError
from piezod.hysteresis import StopForm, SurfaceForm
from piezod.hysteresis.bank import GAINS, THRESHOLDS
from piezod.hysteresis.memory import (
    CHANGE,
    DEFAULT_CAPACITY,
    MAXIMUM,
    MINIMUM,
    PINNED,
    SEEN,
    FloatArray,
)
from piezod.hysteresis.path_relaxation import AT_REST, EXPONENT, FAST, SLOW, WEIGHT
from piezod.hysteresis.rate_lag import ACTIVATION, ADVANCE, PROMPT
from piezod.inverse.feedforward import Feedforward
from piezod.inverse.loaded_model import LoadedModel

LANGUAGES: Final = {"c": ".c", "matlab": ".m"}
"""Languages, and the endings of their files."""
_ORIGIN: Final = {"format", "version", "created_at", "created_by", "method", "source", "fit"}
_RANGES: Final = {"drive_low_v", "drive_high_v", "position_low_um", "position_high_um"}
_PARTS: Final = {
    *("delay_s", "held_s", "creep_time_constants_s", "creep_weights", "first_mode"),
    *("right_stop_thresholds", "right_stop_weights", "left_stop_thresholds", "left_stop_weights"),
    *("surface_coefficients", "surface_activation", "surface_prompt_slope", "surface_path"),
}
_KNOWN: Final = _ORIGIN | _RANGES | _PARTS
_KNOWN_OF_PATH: Final = {"weight", "decay", "skew", "exponent"}
_NAN_UM: Final = 1e30
"""In the vectors of C, which has no constant for it on every compiler."""
_OF_SURFACES: Final = {
    *("activation", "prompt", "advance", "weight", "fast", "slow", "at_rest", "exponent"),
    *("start_pinned", "start_change"),
}


class Numbers(NamedTuple):
    """The numbers of a model, by their names in the code."""

    values: dict[str, float]
    arrays: dict[str, FloatArray]


def exported_code(model: LoadedModel, language: str, path: Path) -> str:
    """Return the text of a file with the inverse of a model.

    Args:
        model: The model, with the rate at which the code will be called.
        language: `c` or `matlab`.
        path: The file, whose name becomes that of the functions.

    Raises:
        ModelError: If the model has a part that the code does not have.
    """
    _check_parts(model.file)
    stage = model.model_at(model.rate_hz)
    numbers = _numbers(stage, model)
    form = "surface" if model.file.is_surface else "stops"
    heading = _heading(model, stage, path)
    um, volts = _vectors(model, stage)
    text = (_matlab if language == "matlab" else _c)(form, numbers, heading, um, volts)
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    name = name if name[:1].isalpha() else f"m{name}"
    text = re.sub(r"\binverse(?=_|\(|\b)", name, text)
    return re.sub(r"\bINVERSE_", f"{name.upper()}_", text)


def _check_parts(file: ModelFile) -> None:
    """Refuse parts of a model that this code does not know."""
    unknown = _unknown(file, _KNOWN)
    if file.surface_path is not None:
        unknown += [f"surface_path.{name}" for name in _unknown(file.surface_path, _KNOWN_OF_PATH)]
    if unknown:
        message = f"the model has {', '.join(unknown)}, which exported code does not have"
        raise ModelError(f"{message}; use `piezod voltages`, or identify without it")


def _unknown(part: ConfigModel, known: set[str]) -> list[str]:
    """Return the fields of a part of a file that have a value and no code."""
    fields = type(part).model_fields.items()
    return [
        name for name, field in fields if name not in known and getattr(part, name) != field.default
    ]


def _numbers(stage: StageModel, model: LoadedModel) -> Numbers:
    start = Feedforward(stage, model.limits, 1.0 / model.rate_hz, model.rest_v).state
    carried = new_kernel(stage.form, stage.weights.copy(), start).carried
    (low_v, high_v), (low_um, high_um) = stage.drive_v, stage.position_um
    values = {
        **{"rate_hz": model.rate_hz, "lookahead_s": model.lookahead_s(model.rate_hz)},
        **{"drive_low_v": low_v, "drive_high_v": high_v},
        **{"position_low_um": low_um, "position_high_um": high_um},
        **{"start_next": float(carried[NEXT]), "start_command": float(carried[COMMAND])},
        "zeroed": start.zeroed,
    }
    creep = {"gain": start.creep.gains, "weight": start.creep.weights, "start": start.lags}
    arrays = {f"lag_{name}": array for name, array in creep.items()}
    arrays["start"] = _turns(start)
    match stage.form:
        case SurfaceForm(terms=terms):
            indices = {
                **{"activation": ACTIVATION, "prompt": PROMPT, "advance": ADVANCE},
                **{"weight": WEIGHT, "fast": FAST, "slow": SLOW, "at_rest": AT_REST},
                "exponent": EXPONENT,
            }
            values |= {name: float(terms[index]) for name, index in indices.items()}
            if start.memory is not None:
                pinned, change = start.memory.last[[PINNED, CHANGE]].tolist()
                values |= {"start_pinned": pinned, "start_change": change}
            arrays["coefficient"] = stage.weights
        case StopForm(bank):
            arrays |= {"threshold": bank[THRESHOLDS], "factor": stage.weights * bank[GAINS]}
        case _:
            raise ModelError(f"there is no code for a {type(stage.form).__name__}")
    return Numbers(values, arrays)


def _turns(start: CreepState) -> FloatArray:
    """Return the inputs that lead a relaxed memory to that of the start, shape (n,)."""
    if start.memory is None:
        return np.array([start.quick])
    levels, counts = start.memory.levels, start.memory.counts
    sides = (levels[side, 1 : counts[side]].tolist() for side in (MAXIMUM, MINIMUM))
    turns = chain.from_iterable(zip_longest(*sides))
    return np.array([*(each for each in turns if each is not None), start.memory.last[SEEN]])


def _heading(model: LoadedModel, stage: StageModel, path: Path) -> Mapping[str, object]:
    (low_v, high_v), (low_um, high_um) = stage.drive_v, stage.position_um
    mode = "The model has no first mode."
    if stage.mode:
        mode = f"The stage rings at {stage.mode.frequency_hz:.4g} Hz: round the corners yourself."
    return {
        "title": f"{path.name} of a model that piezod has identified",
        "version": version("piezod"),
        "file": f"a model of {_remark(model.file.created_at)}",
        "operators": model.file.operators,
        "source": _remark(model.file.source.file),
        **{"low_v": f"{low_v:.6g}", "high_v": f"{high_v:.6g}", "rest_v": f"{model.rest_v:.6g}"},
        **{"low_um": f"{low_um:.6g}", "high_um": f"{high_um:.6g}"},
        "rate_hz": f"{model.rate_hz:.9g}",
        "lookahead_s": f"{model.lookahead_s(model.rate_hz):.9g}",
        "mode": mode,
    }


def _remark(text: object) -> str:
    """Return a text of a model file that cannot end the remark in which it stands."""
    one_line = "".join(each if each.isprintable() else " " for each in str(text))
    return one_line.replace("*/", "* /").replace("/*", "/ *")


def _vectors(model: LoadedModel, stage: StageModel) -> tuple[FloatArray, FloatArray]:
    """Return positions in µm for the self-test, shape (n,), and the voltages for them, in V."""
    draws, k = np.random.default_rng(1), np.arange(150)
    unit = np.concatenate(
        (
            0.5 - 0.5 * np.cos(k / 150 * 4.0 * np.pi),  # the whole range
            0.5 - 0.4 * np.cos(k / 5.0) * np.exp(-k / 60.0),  # loops that shrink
            0.5 + 0.45 * (-1.0) ** k * 0.96**k,  # more turning points than the memory holds
            draws.uniform(-0.2, 1.2, 60),
            0.4 + np.cumsum(draws.normal(0.0, 0.02, 60)),
            [np.nan, 0.3, 0.3, np.nan, 2.0, -1.0, 0.7],
            0.7 - 0.6 * k / 150.0,
        )
    )
    um = stage.position_um.from_unit(unit)
    law = Feedforward(stage, model.limits, 1.0 / model.rate_hz, model.rest_v)
    return um, np.array([law.step(each) for each in um.tolist()])


def _texts(language: str, names: Iterable[str], heading: Mapping[str, object]) -> list[str]:
    folder, ending = files("piezod.inverse") / language, LANGUAGES[language]
    texts = [(folder / f"{name}{ending}").read_text(encoding="utf-8") for name in names]
    return [Template(texts[0]).substitute(heading), *texts[1:]]


def _c(
    form: str, numbers: Numbers, heading: Mapping[str, object], um: FloatArray, volts: FloatArray
) -> str:
    parts = ["functions", "surface"] if form == "surface" else ["stops"]
    head, memory, *others, test, tail = _texts(
        "c", ("head", "memory", *parts, "self_test", "tail"), heading
    )
    surface = form == "surface"
    constants = _c_surface(numbers) if surface else _c_stops(numbers)
    arrays = numbers.arrays
    lags = [_c_array(name, arrays[name]) for name in arrays if name.startswith("lag_")]
    common = [name for name in numbers.values if name not in _OF_SURFACES]
    shown = np.where(np.isnan(um), _NAN_UM, um)
    vectors = [
        f"#define INVERSE_VECTORS {um.size}",
        "#ifdef INVERSE_FLOAT",
        f"#define INVERSE_TOLERANCE R({1e-3 if surface else 1e-5})",
        "#else",
        "#define INVERSE_TOLERANCE R(1e-12)",
        "#endif",
        _c_array("test_um", shown),
        _c_array("test_v", volts),
    ]
    size = arrays["lag_gain"].size
    return "\n".join(
        (
            head,
            f"#define INVERSE_EXTREMA {DEFAULT_CAPACITY} /* turning points kept on each side */",
            f"#define INVERSE_LAGS {size}",
            f"#define INVERSE_TURNS {arrays['start'].size}",
            _c_array("start", arrays["start"]),
            *(_c_define(name, numbers.values[name]) for name in common),
            *(lags if size else ()),
            *constants,
            "",
            memory,
            *others,
            test.replace("$vectors", "\n".join(vectors)),
            tail,
        )
    )


def _c_stops(numbers: Numbers) -> list[str]:
    """Return the constants of stops, padded to a multiple of four by stops without weight."""
    right, left = np.split(numbers.arrays["threshold"], 2)
    factors = np.split(numbers.arrays["factor"], 2)
    spare = -right.size % 4

    def padded(values: FloatArray, value: float) -> FloatArray:
        return np.concatenate((values, np.full(spare, value)))

    return [
        f"#define INVERSE_ORDER {right.size + spare}",
        "#define INVERSE_WIDTH (2 * INVERSE_ORDER + 2)",
        _c_array("right_threshold", padded(right, 0.0)),
        _c_array("right_slope", padded(1.0 / (1.0 - right), 1.0)),
        _c_array("left_slope", padded(1.0 / (1.0 - left), 1.0)),
        _c_array("right_factor", padded(factors[0], 0.0)),
        _c_array("left_factor", padded(factors[1], 0.0)),
    ]


def _c_surface(numbers: Numbers) -> list[str]:
    values, names = numbers.values, {"start_pinned": "start_pinned", "start_change": "start_change"}
    if values["activation"]:
        names |= {"lag": "activation", "prompt": "prompt", "advance": "advance"}
    if values["fast"]:
        names |= {"path": "weight", "fast": "fast", "slow": "slow", "at_rest": "at_rest"}
        if values["exponent"] != 1.0:
            names["exponent"] = "exponent"
    return [
        "#define INVERSE_SURFACE",
        "#define INVERSE_WIDTH 1",
        *(["#define INVERSE_OPEN_LOOPS"] if values["fast"] else []),
        *(_c_define(name, values[key]) for name, key in names.items()),
        _c_array("coefficient", numbers.arrays["coefficient"]),
    ]


def _c_define(name: str, value: float) -> str:
    return f"#define INVERSE_{name.upper()} {_hex(value)}"


def _hex(value: float) -> str:
    return f"R({float(value).hex()})"


def _c_array(name: str, values: FloatArray) -> str:
    rows = [", ".join(map(_hex, values[i : i + 4])) for i in range(0, len(values), 4)]
    lines = ",\n    ".join(rows)
    return f"static const real inverse_{name}[{len(values)}] = {{\n    {lines}}};"


def _matlab(
    form: str, numbers: Numbers, heading: Mapping[str, object], um: FloatArray, volts: FloatArray
) -> str:
    head, *others = _texts("matlab", ("head", "memory", form), heading)
    values, arrays = {**numbers.values, "extrema": float(DEFAULT_CAPACITY)}, numbers.arrays
    width = 1 if form == "surface" else arrays["threshold"].size
    values |= {"width": float(width), "order": float(width // 2)}
    constants = [f"c.{name} = {value!r};" for name, value in values.items()]
    constants += [f"c.{name} = {_matlab_array(array)};" for name, array in arrays.items()]
    if form == "surface":
        constants.append("c.coefficient = reshape(c.coefficient, 4, 6)';")
    width_v = values["drive_high_v"] - values["drive_low_v"]
    return "\n".join(
        (
            head,
            *("", "% ---- numbers of the model ----", "", "function c = constants()"),
            *constants,
            "end",
            *others,
            *("", "function [position_um, expected_v, drive_range_v] = vectors()"),
            f"position_um = {_matlab_array(um)};",
            f"expected_v = {_matlab_array(volts)};",
            f"drive_range_v = {width_v!r};",
            "end",
            "",
        )
    )


def _matlab_array(values: FloatArray) -> str:
    """Return numbers such that MATLAB reads the same doubles."""
    texts = [repr(each) if isfinite(each) else "NaN" for each in values.tolist()]
    rows = [" ".join(texts[i : i + 4]) for i in range(0, len(texts), 4)]
    return "[" + " ...\n  ".join(rows) + "]"
