"""Model files: written and read without loss, and refused if they are invalid."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from piezod.config.experiment import ExperimentConfig
from piezod.config.model_file import FitConfig, ModelFile, SourceConfig, dump_model, load_model
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import ConfigError

MODEL = ModelFile(
    created_at="2024-05-01T12:00:00+00:00",
    created_by="piezod 0.1.0",
    method="least-squares",
    source=SourceConfig(file="identification.csv", sha256="1e3" + "0" * 61),
    fit=FitConfig(voltage_error_max_pct=1.5, voltage_error_rms_pct=1e-7),
    drive_low_v=0,
    drive_high_v=150,
    position_low_um=-0.1,
    position_high_um=26.123456789012345,
    delay_s=1.1e-4,
    creep_time_constants_s=(0.1, 10**0.5, 100.0),
    creep_weights=(0.01, 1 / 300, 0.0),
    right_stop_thresholds=(0.25, 0.5, 0.75),
    right_stop_weights=(0.1, -0.2, 1 / 3),
    left_stop_thresholds=(0.5,),
    left_stop_weights=(-1e-9,),
)
TEXT = dump_model(MODEL)
HIGH, CREEPING = "26.123456789012344", "[0.01, 0.0033333333333333335, 0.0]"
LEFT = "left_stop_weights:"


def test_learned_weights_are_in_the_order_of_the_loop() -> None:
    """The left stops come first, however many there are on each side."""
    learned = MODEL.with_weights([0.5, 0.1, 0.2, 0.3])

    assert learned.left_stop_weights == (0.5,)
    assert learned.right_stop_weights == (0.1, 0.2, 0.3)
    assert learned.right_stop_thresholds == MODEL.right_stop_thresholds


def problems_of(path: Path, old: str, new: str) -> list[str]:
    """Return the problems of the model file after replacing a part of its text."""
    assert TEXT.count(old) == 1
    path.write_text(TEXT.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_model(path)
    return [str(problem).replace(problem.file, "m.yaml") for problem in caught.value.problems]


def test_text_of_a_model_file() -> None:
    """A model file is readable: one fact per line, long lists folded."""
    assert TEXT.splitlines()[:8] == [
        "# Model of a stage for piezod.",
        'format: "piezod-model"',
        "version: 1",
        'created_at: "2024-05-01T12:00:00+00:00"',
        'created_by: "piezod 0.1.0"',
        'method: "least-squares"',
        "source:",
        '  file: "identification.csv"',
    ]
    assert TEXT.splitlines()[-4:] == [
        "left_stop_thresholds:",
        "  [0.5]",
        "left_stop_weights:",
        "  [-1e-09]",
    ]
    assert "surface" not in TEXT  # a key that older versions would refuse
    assert max(map(len, TEXT.splitlines())) <= 100


def test_round_trip(tmp_path: Path) -> None:
    """A written model is read back to the last bit."""
    path = tmp_path / "m.yaml"
    path.write_text(TEXT, encoding="utf-8")

    assert load_model(path) == MODEL


WEIGHTS = st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3).map(tuple)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=255)


CREEP = st.lists(st.tuples(st.floats(1e-4, 1e6), st.floats(0, 0.1)), max_size=9)


@given(weights=WEIGHTS, name=NAMES, delay_s=st.floats(0, 1), creep=CREEP)
def test_any_model_round_trips(
    weights: tuple[float, ...], name: str, delay_s: float, creep: list[tuple[float, float]]
) -> None:
    """Any numbers and any name of a source survive, also a name like a number."""
    model = ModelFile.model_validate(
        MODEL.model_dump()
        | {
            "right_stop_weights": weights,
            "delay_s": delay_s,
            "creep_time_constants_s": tuple(time_constant_s for time_constant_s, _ in creep),
            "creep_weights": tuple(weight for _, weight in creep),
            "source": {"file": name, "sha256": "0" * 64},
        }
    )

    assert ModelFile.model_validate(parse_yaml(dump_model(model), "m").data) == model


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"piezod-model"', '"model"', "2:9: format: unknown value (got 'model')"),
        ("version: 1", "version: 4", "3:10: version: unknown value (got 4)"),
        ('"least-squares"', "guess", "6:9: method: unknown value (got 'guess')"),
        ("1e30", "1E30", "9:11: source.sha256: not well formed"),
        ("_max_pct: 1.5", "_max_pct: -1", "11:26: fit.voltage_error_max_pct: out of range"),
        ("drive_high_v: 150.0", "drive_high_v: 0", "14:15: drive_high_v: must be above"),
        (f"position_high_um: {HIGH}", "position_high_um: -1", "16:19: position_high_um: must be"),
        ("[0.1, 3.1622776601683795, 100.0]", "[0, 1, 2]", "19:4: creep_time_constants_s[0]: out"),
        (CREEPING, "[0.01]", "21:3: creep_weights: needs one entry for each time constant"),
        (CREEPING, "[0.1, -0.1, 0]", "21:9: creep_weights[1]: out of range"),
        ("[0.25, 0.5, 0.75]", "[0.25, 0.75, 0.5]", "23:16: right_stop_thresholds[2]: must be"),
        ("[0.5]", "[0.5, 0.5]", "27:9: left_stop_thresholds[1]: must be above the threshold"),
        ("[0.5]", "[1]", "27:4: left_stop_thresholds[0]: out of range"),
        ("[0.5]", "[]", "27:3: left_stop_thresholds: a file of version 1 has at least one"),
        (LEFT, f"surface_coefficients: [0.5]\n{LEFT}", "28:23: surface_coefficients: a file of"),
        ("[-1e-09]", "[]", "29:3: left_stop_weights: needs one entry for each threshold"),
        ("[-1e-09]", "[0, 0]", "29:3: left_stop_weights: needs one entry for each threshold"),
        ("[-1e-09]", "[.nan]", "29:4: left_stop_weights[0]: must be a finite number"),
    ],
)
def test_one_mistake(tmp_path: Path, old: str, new: str, expected: str) -> None:
    """Each mistake gives one line that begins with the place and what is wrong there."""
    problem, *others = problems_of(tmp_path / "m.yaml", old, new)

    assert problem.startswith(f"m.yaml:{expected}")
    assert [line for line in others if "one entry for each" not in line] == []


def test_creep_that_cannot_be_taken_out(tmp_path: Path) -> None:
    """If the creep weights add up to 1, the removal would be unstable."""
    creep = MODEL.model_copy(
        update={"creep_time_constants_s": (10.0,) * 11, "creep_weights": (0.1,) * 11}
    )
    path = tmp_path / "m.yaml"
    path.write_text(dump_model(creep), encoding="utf-8")

    with pytest.raises(ConfigError, match="creep_weights: sum must be below 1"):
        load_model(path)


def test_file_without_creep_is_a_stage_without_it(tmp_path: Path) -> None:
    """Both keys may be absent together."""
    path = tmp_path / "m.yaml"
    lines = TEXT.splitlines()
    assert [line.partition(":")[0] for line in lines[17:20:2]] == [
        "creep_time_constants_s",
        "creep_weights",
    ]
    path.write_text("\n".join(lines[:17] + lines[21:]), encoding="utf-8")

    assert load_model(path).creep_weights == load_model(path).creep_time_constants_s == ()


def test_model_made_in_python_obeys_the_rules() -> None:
    """The rules also apply to a model made in Python."""
    with pytest.raises(ValidationError, match="must be above drive_low_v"):
        ModelFile.model_validate(MODEL.model_dump() | {"drive_low_v": 150.0})


def test_experiment_starts_from_a_model(
    load: Callable[..., ExperimentConfig], tmp_path: Path
) -> None:
    """An axis may name a model file beside the experiment; then nothing is identified."""
    (tmp_path / "m.yaml").write_text(TEXT, encoding="utf-8")
    experiment = load(*WITH_MODEL, (IDENTIFICATION, ""))

    assert experiment.axes["x"].model == tmp_path / "m.yaml"
    assert experiment.identification is None


def test_identification_that_is_not_used(
    problems_of: Callable[..., list[str]], tmp_path: Path
) -> None:
    """If every axis has a model file, an identification is refused, because it would be ignored."""
    (tmp_path / "m.yaml").write_text(TEXT, encoding="utf-8")

    assert problems_of(*WITH_MODEL) == [
        "test.yaml:14:1: identification: not used, every axis starts from a model file"
    ]


def test_broken_model_is_told_with_its_place(
    problems_of: Callable[..., list[str]], tmp_path: Path
) -> None:
    """The model files of an experiment are checked with it."""
    path = tmp_path / "m.yaml"
    path.write_text(TEXT.replace("version: 1", "version: 4"), encoding="utf-8")

    assert problems_of(*WITH_MODEL, (IDENTIFICATION, "")) == [
        f"test.yaml:10:12: axes.x.model: {path}:3:10: version: unknown value (got 4), "
        "allowed: 1, 2 or 3"
    ]


def test_experiment_is_no_model(problems_of: Callable[..., list[str]], tmp_path: Path) -> None:
    """A file of another kind gets one message instead of a list of keys."""
    path = tmp_path / "m.yaml"
    path.write_text("rate_hz: 1000\nseed: 3\n", encoding="utf-8")

    assert problems_of(*WITH_MODEL, (IDENTIFICATION, "")) == [
        f"test.yaml:10:12: axes.x.model: {path}: not a model file, it has none of the keys of "
        "one; `piezod identify` makes model files"
    ]


def test_compensator_keys_that_the_model_decides(
    problems_of: Callable[..., list[str]], tmp_path: Path
) -> None:
    """Keys that the model file replaces are refused, because they would be ignored."""
    (tmp_path / "m.yaml").write_text(TEXT, encoding="utf-8")
    model, compensator = WITH_MODEL
    keys = (compensator[0], "operators: 19, delay_s: auto, creep: true, thresholds: even, ")

    assert problems_of(model, keys, (IDENTIFICATION, "")) == [
        "test.yaml:13:30: axes.x.compensator.operators: not used, the model file has its own "
        "operators, leave it out",
        "test.yaml:13:43: axes.x.compensator.delay_s: not used, the model file has its own delay, "
        "leave it out",
        "test.yaml:13:56: axes.x.compensator.creep: not used, the model file has its own creep, "
        "leave it out",
        "test.yaml:13:74: axes.x.compensator.thresholds: not used, the model file has its own "
        "thresholds, leave it out",
    ]


WITH_MODEL = (
    ("    sensor: rig\n", "    sensor: rig\n    model: m.yaml\n"),
    ("operators: 19, ", ""),
)
IDENTIFICATION = """\
identification:
  method: least-squares
  settle_s: 5
  duration_s: 30
  drive_v: {kind: sine, low: 0, high: 148, frequency_hz: 0.4}
"""
