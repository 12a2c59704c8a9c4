"""Tests of the kind of a file, found by its content."""

import re
from pathlib import Path

import pytest

from piezod.experiment.check_file import Checked, FileKind, check_file

CONFIG = Path(__file__).parents[2] / "config"
MODELS = CONFIG / "models"


def check(tmp_path: Path, text: str) -> tuple[FileKind | None, str, list[str]]:
    """Return kind, contents and problems of a text, without the folder."""
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="utf-8")
    kind, contents, error, *_ = check_file(path)
    problems = str(error).replace(str(path), "file.yaml").splitlines() if error else []
    return kind, contents, problems


def test_experiment_is_described(tmp_path: Path, short: str) -> None:
    """The summary is for people."""
    assert check(tmp_path, short) == (
        FileKind.EXPERIMENT,
        "an experiment: 1 case in 3 modes on 1 axis",
        [],
    )


def test_stage_is_described() -> None:
    """The configuration of the repository is a stage with safe gains."""
    kind, contents, error, *_ = check_file(CONFIG / "simulated.yaml")

    assert (kind, contents, error) == (FileKind.STAGE, "a stage: 1 axis at 200 Hz", None)


def checked(stage: str, folder: Path, without: str | None = None) -> Checked:
    """Return the check of a stage of the repository, without the line of a key."""
    text = (CONFIG / stage).read_text(encoding="utf-8")
    path = folder / stage
    lines = [line for line in text.splitlines() if without is None or without not in line]
    path.write_text("\n".join(lines).replace("model: models", f"model: {MODELS}"), encoding="utf-8")
    return check_file(path)


@pytest.mark.parametrize(
    ("stage", "borrow"), [("simulated.yaml", ""), ("open-loop.yaml", "borrow a sensor, ")]
)
def test_missing_model_is_a_warning(tmp_path: Path, stage: str, borrow: str) -> None:
    """Without a model nothing is compensated, and the warning says how to get one."""
    known, unknown = checked(stage, tmp_path), checked(stage, tmp_path, without="model:")

    assert not any("has no `model`" in each for each in known.warnings)
    assert unknown.error is None
    assert unknown.warnings[0] == (
        "axis x: it has no `model`. Its drive is proportional to the command, as in "
        "`uncompensated`, until a model has been identified and adopted. To have one at each "
        f"start, {borrow}run `piezod identify --live --out MODEL.yaml` on the running stage, and "
        "name the file as `model`, relative to this one"
    )


@pytest.mark.parametrize(
    ("wait_ms", "rate_hz", "told"), [(5, 500, 0), (1500, 500, 1), (1500, 1, 0), (3000, 1, 1)]
)
def test_wait_that_may_end_the_loop_is_a_warning(
    tmp_path: Path, wait_ms: int, rate_hz: int, told: int
) -> None:
    """A loop that stands still for long is killed: no device may be awaited that long."""
    text = (CONFIG / "devices/canopen-401.yaml").read_text(encoding="utf-8")
    text = text.replace("timeout_ms: 5", f"timeout_ms: {wait_ms}")
    text = text.replace("rate_hz: 500", f"rate_hz: {rate_hz}")
    (tmp_path / "stage.yaml").write_text(text.replace("../models", str(MODELS)), "utf-8")

    assert (
        sum("timeout_ms" in each for each in check_file(tmp_path / "stage.yaml").warnings) == told
    )


def test_unknown_first_mode_is_a_warning(tmp_path: Path) -> None:
    """Learning allows for a slow mode only if the configuration or the model tells it."""
    known = checked("simulated.yaml", tmp_path)
    unknown = checked("simulated.yaml", tmp_path, without="first_mode")

    assert (known.error, known.warnings) == (None, ())
    assert unknown.error is None
    assert unknown.warnings[0].startswith(
        "axis x: neither `first_mode` nor `response` nor the model tells its first mode. A mode "
        "with a damping of 0.01 may oscillate in `adaptive` below 55 Hz, in `trimmed` below "
    )


def test_axis_without_a_sensor_is_named() -> None:
    """A forgotten sensor is reported before the first run."""
    found = check_file(CONFIG / "open-loop.yaml")

    assert found.contents == "a stage: 1 axis at 200 Hz; x without a sensor"


def test_groups_are_described(tmp_path: Path) -> None:
    """The summary counts each stage once."""
    found = check(tmp_path, "groups: {raster: [a, b], all: [a, b, c]}\n")

    assert found == (FileKind.GROUPS, "groups of stages: 2 groups of 3 stages", [])


@pytest.mark.parametrize(
    ("text", "kind", "problem"),
    [
        ("modes: [adaptive]\n", FileKind.EXPERIMENT,
         "file.yaml:1:1: rate_hz: required key is missing"),
        ("format: old\n", FileKind.MODEL, "file.yaml:1:1: created_at: required key is missing"),
        ("delay_s: 0\n", FileKind.MODEL, "file.yaml:1:1: created_at: required key is missing"),
        ("resonances: []\n", FileKind.RESPONSE,
         "file.yaml:1:1: created_at: required key is missing"),
        ("groups: {raster: []}\n", FileKind.GROUPS,
         "file.yaml:1:18: groups.raster: a group has at least one stage"),
        ("a: 1\na: 2\n", None, "file.yaml:2:1: duplicate key 'a', first in line 1"),
        ("- 1\n", None, "file.yaml:1:1: the top level must be a mapping, lines of `key: value`"),
    ],
)  # fmt: skip
def test_kind_follows_from_the_keys(
    tmp_path: Path, text: str, kind: FileKind | None, problem: str
) -> None:
    """A file with errors has the kind of most of its keys."""
    found, contents, problems = check(tmp_path, text)

    assert (found, contents, problems[0]) == (kind, "", problem)


@pytest.mark.parametrize("text", ["a: 1\n", "delay_s: 0\nseed: 1\n"])
def test_file_of_neither_kind(tmp_path: Path, text: str) -> None:
    """The refusal describes each kind."""
    kind, _, (problem,) = check(tmp_path, text)

    assert kind is None
    assert problem.startswith("file.yaml: not a stage, experiment, model or response; allowed")


def with_frequency(short: str, frequency_hz: float) -> str:
    """Return the short experiment with another frequency of its command."""
    head, cases, tail = short.partition("cases:")
    return head + cases + re.sub(r"frequency_hz: [\d.]+", f"frequency_hz: {frequency_hz}", tail)


def test_fast_commands_are_told(tmp_path: Path, short: str) -> None:
    """A command above half of the rate is a problem, above a tenth a warning, and nothing below."""
    path = tmp_path / "fast.yaml"
    found = []
    for frequency_hz in (90, 200, 600):
        path.write_text(with_frequency(short, frequency_hz), encoding="utf-8")
        found.append(check_file(path))
    slow, fast, impossible = found

    assert (slow.error, slow.warnings) == (None, ())
    assert fast.error is None
    assert "200 Hz is more than a tenth of the rate, 1000 Hz" in fast.warnings[0]
    assert "too fast for the loop (got 600 Hz), allowed: below 500 Hz" in str(impossible.error)
