"""Experiment files: the values read, and the exact text of refusals."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import ValidationError

from piezod.config.axes import LimitsConfig
from piezod.config.devices import DeviceConfig
from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.first_mode import FirstModeConfig
from piezod.config.modes import Mode
from piezod.config.trim import TrimConfig
from piezod.devices import registry
from piezod.errors import ConfigError

Load = Callable[..., ExperimentConfig]
ProblemsOf = Callable[..., list[str]]

SHIPPED = sorted((Path(__file__).parents[2] / "config" / "experiments").glob("*.yaml"))
RANGE = "    command_range_um: [0, 26]"
AXIS_Y = """\
axes:
  y:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
"""


def test_values_are_as_written(load: Load) -> None:
    """An experiment has the values of its file."""
    experiment = load()

    assert experiment.rate_hz == 1000.0
    assert LimitsConfig(drive_min_v=0, drive_max_v=150, slew_v_per_s=20000, rest_v=0) == (
        experiment.axes["x"].limits
    )
    assert experiment.modes == (Mode.FEEDFORWARD, Mode.ADAPTIVE)
    assert experiment.devices["rig"].options.model_dump() == {"variant": "stack", "gain": 2.5}


def test_defaults_are_filled_in(load: Load) -> None:
    """A key that is absent has its documented default."""
    experiment = load(("    options: {variant: stack, gain: 2.5}\n", ""))

    assert (experiment.seed, experiment.settle_s) == (1, 2.0)
    assert (
        experiment.axes["x"].compensator.delay_s,
        experiment.axes["x"].compensator.deadband_pct,
    ) == ("auto", 0.1)
    assert experiment.devices["rig"].options.model_dump() == {"variant": "stack", "gain": 1.0}


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        (
            "first_mode: {frequency_hz: 734, damping: 0.015}",
            FirstModeConfig(frequency_hz=734.0, damping=0.015),
        ),
        (
            "trim: {base: adaptive, gain_per_s: 20, authority_pct: 2}",
            TrimConfig(base="adaptive", gain_per_s=20.0, authority_pct=2.0),
        ),
    ],
)
def test_optional_keys_of_an_axis_are_read(load: Load, key: str, expected: object) -> None:
    """The gain of a trim has no default: it depends on mode and delay of the stage."""
    rest, given = load().axes["x"], load((RANGE, f"{RANGE}\n    {key}")).axes["x"]

    assert getattr(given, key.partition(":")[0]) == expected
    assert rest.first_mode is None
    assert rest.trim == TrimConfig(base="feedforward", gain_per_s=None, authority_pct=5.0)


def test_nothing_can_be_changed(load: Load) -> None:
    """A configuration is frozen."""
    with pytest.raises(ValidationError, match="frozen"):
        load().axes["x"].limits.rest_v = 1.0  # type: ignore[misc] # what the test is about


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_shipped_experiments_load(path: Path) -> None:
    """Every shipped experiment is valid, including the options of its drivers."""
    experiment = load_experiment(path, registry)

    assert experiment.cases or experiment.play


def test_experiments_ship() -> None:
    """The paper's experiment is among the shipped ones."""
    assert "qiu.yaml" in [path.name for path in SHIPPED]


def test_mistakes_in_options_of_a_foreign_kind(problems_of: ProblemsOf) -> None:
    """Options of another kind of model get the same messages."""
    options = "{prot: COM1, baud_rate: 2.5, verbose: 1}"
    changes = (("driver: bench", "driver: port"), ("{variant: stack, gain: 2.5}", options))

    assert problems_of(*changes) == [
        "test.yaml:5:5: devices.rig.options.port: required key is missing",
        "test.yaml:5:15: devices.rig.options.prot: unknown key, did you mean 'port'?",
        "test.yaml:5:38: devices.rig.options.baud_rate: must be a whole number (got 2.5)",
        "test.yaml:5:52: devices.rig.options.verbose: must be true or false (got 1)",
    ]


def test_all_mistakes_at_once(problems_of: ProblemsOf) -> None:
    """All problems of a file are reported together, in the order of its lines."""
    places = [
        line.split(": ")[0]
        for line in problems_of(
            ("rate_hz: 1000", "rate_hz: 0"),
            ("driver: bench", "driver: benhc"),
            ("sensor: rig", "sensor: 7"),
            ("lms_gain: 0.1", "lms_gain: 2"),
            ("low: 0, high: 25", "low: 30, high: 25"),
        )
    ]

    assert places == [
        "test.yaml:1:10",
        "test.yaml:4:13",
        "test.yaml:9:13",
        "test.yaml:12:44",
        "test.yaml:23:49",
    ]


def test_axes_are_mandatory(problems_of: ProblemsOf) -> None:
    """A file without `axes:`, or with an empty one, is refused."""
    assert "test.yaml:1:1: axes: required key is missing" in problems_of(("\naxes:", "\naxis:"))

    start = "axes:\n  x:\n    amplifier: rig\n    sensor: rig\n"
    empty = ("axes: {}\nz:\n  x:\n    amplifier: rig\n    sensor: rig\n",)
    assert "test.yaml:6:1: axes: too few entries (got 0), allowed: at least 1" in problems_of(
        (start, *empty)
    )


def test_case_names_are_unique(problems_of: ProblemsOf) -> None:
    """Two cases of the same name are refused."""
    cases = """\
cases:
  - {name: case 1, period_s: 1, duration_s: 2, command_um: {kind: setpoint, level: 0}}
"""

    assert problems_of(("cases:\n", cases)) == [
        "test.yaml:21:11: cases[1].name: appears twice (got 'case 1')"
    ]


def test_identification_or_model(problems_of: ProblemsOf) -> None:
    """An axis without a model file needs the identification."""
    text = """\
identification:
  method: least-squares
  settle_s: 5
  duration_s: 30
  drive_v: {kind: sine, low: 0, high: 148, frequency_hz: 0.4}
"""

    assert problems_of((text, "")) == [
        "test.yaml:7:3: axes.x: needs a model file, or `identification:` to make the model"
    ]


def test_one_command_for_all_axes(load: Load) -> None:
    """A waveform under `command_um` is the command of every axis."""
    experiment = load(("axes:\n", AXIS_Y))

    commands = experiment.cases[0].commands(experiment.axes)
    assert list(commands) == ["y", "x"]
    assert commands["x"] == commands["y"]


def test_a_command_for_each_axis(load: Load) -> None:
    """`axes:` under `command_um` gives each axis its own command."""
    experiment = load(
        ("axes:\n", AXIS_Y),
        (
            "{kind: triangle, low: 0, high: 25, frequency_hz: 0.5}",
            "{axes: {x: {kind: setpoint, level: 3}, y: {kind: setpoint, level: 4}}}",
        ),
    )

    commands = experiment.cases[0].commands(experiment.axes)
    assert {name: waveform.bounds() for name, waveform in commands.items()} == {
        "x": (3.0, 3.0),
        "y": (4.0, 4.0),
    }


def test_commands_must_fit_the_axes(problems_of: ProblemsOf) -> None:
    """Every axis has a command, and every command has an axis."""
    changes = (
        ("axes:\n", AXIS_Y),
        (
            "{kind: triangle, low: 0, high: 25, frequency_hz: 0.5}",
            "{axes: {x: {kind: setpoint, level: 27}, z: {kind: setpoint, level: 4}}}",
        ),
    )

    assert problems_of(*changes) == [
        "test.yaml:27:18: cases[0].command_um.axes: no command for axis y",
        "test.yaml:27:25: cases[0].command_um.axes.x: may exceed the range of axis x "
        "(got 27 to 27 µm), allowed range 0 to 26 µm",
        "test.yaml:27:57: cases[0].command_um.axes.z: no such axis, known: y, x",
    ]


def test_device_that_no_axis_uses(problems_of: ProblemsOf) -> None:
    """An unused device is refused; one role is enough."""
    spare = ("devices:\n", "devices:\n  spare: {driver: bench}\n")

    assert problems_of(spare) == [
        "test.yaml:3:3: devices.spare: no axis uses this device, leave it out or name it in an axis"
    ]


def test_one_role_is_enough_for_a_device(load: Load) -> None:
    """A device may be a sensor only."""
    changes = (
        ("devices:\n", "devices:\n  gauge: {driver: bench}\n"),
        ("sensor: rig", "sensor: gauge"),
    )

    assert list(load(*changes).devices) == ["gauge", "rig"]


@pytest.mark.parametrize(
    ("rate_hz", "duration_s", "shortest_s"), [(1000, 2.009, 2.01), (10, 2.9, 3), (10, 2.001, 3)]
)
def test_case_must_leave_something_to_judge(
    problems_of: ProblemsOf, rate_hz: float, duration_s: float, shortest_s: float
) -> None:
    """After the first period, which is excluded, ten samples are needed."""
    changes = (
        ("rate_hz: 1000", f"rate_hz: {rate_hz}"),
        ("duration_s: 20", f"duration_s: {duration_s}"),
        ("duration_s: 30", "duration_s: 300"),
    )

    assert problems_of(*changes) == [
        f"test.yaml:22:17: cases[0].duration_s: leaves fewer than 10 samples after period_s at "
        f"{rate_hz} Hz (got {duration_s} s), allowed: at least {shortest_s} s"
    ]


@pytest.mark.parametrize(
    ("rate_hz", "duration_s", "period_s"), [(1000, 2.01, 2), (10, 3, 2), (333, 2.1, 2)]
)
def test_shortest_case(load: Load, rate_hz: float, duration_s: float, period_s: float) -> None:
    """Ten samples are enough, and a period of the loop need not be whole nanoseconds."""
    experiment = load(
        ("rate_hz: 1000", f"rate_hz: {rate_hz}"),
        ("duration_s: 20", f"duration_s: {duration_s}"),
        ("duration_s: 30", "duration_s: 300"),
        ("period_s: 2", f"period_s: {period_s}"),
    )

    assert experiment.cases[0].duration_s == duration_s


def test_identification_must_be_long_enough_for_its_weights(
    problems_of: ProblemsOf, load: Load
) -> None:
    """Each weight needs five samples; 19 operators on each side have 38 weights."""
    assert problems_of(("duration_s: 30", "duration_s: 0.189")) == [
        "test.yaml:16:15: identification.duration_s: too short for the 38 weights of axis x at "
        "1000 Hz (got 0.189 s), allowed: at least 0.19 s"
    ]
    assert load(("duration_s: 30", "duration_s: 0.19")).identification


def test_run_in_does_not_count_for_the_length(problems_of: ProblemsOf, load: Load) -> None:
    """The part after the run-in must be long enough for the weights."""
    assert problems_of(("duration_s: 30", "duration_s: 30\n  run_in_s: 29.9")) == [
        "test.yaml:16:15: identification.duration_s: too short after run_in_s, 29.9 s, for the 38 "
        "weights of axis x at 1000 Hz (got 30 s), allowed: at least 30.09 s"
    ]
    assert load(("duration_s: 30", "duration_s: 30\n  run_in_s: 29.8")).identification


COMPENSATOR = "operators: 19, lms_gain: 0.1"


@pytest.mark.parametrize(
    ("compensator", "problem"),
    [
        ("identifier: rls, lms_gain: 0.1", "12:46: axes.x.compensator.lms_gain: not used, "
         "identifier rls has no gain, leave it out"),
        ("lms_gain: 0.1, thresholds: graded", "12:46: axes.x.compensator.thresholds: graded needs "
         "identifier rls (identifier is lms)"),
        ("thresholds: odd", "12:31: axes.x.compensator.thresholds: unknown value (got 'odd'), "
         "allowed: even, graded, placed"),
        ("creep: 1", "12:26: axes.x.compensator.creep: must be true or false (got 1)"),
    ],
)  # fmt: skip
def test_compensator_that_cannot_be(
    problems_of: ProblemsOf, compensator: str, problem: str
) -> None:
    """Ignored keys and contradictions are refused."""
    assert problems_of((COMPENSATOR, compensator)) == [f"test.yaml:{problem}"]


@pytest.mark.parametrize(
    ("compensator", "identifier"),
    [("", "rls"), ("thresholds: graded", "rls"), ("lms_gain: 0.1", "lms")],
)
def test_default_identifier_works_with_any_model(
    load: Load, compensator: str, identifier: str
) -> None:
    """Without the key it is least squares; a gain alone still means LMS."""
    config = load((COMPENSATOR, compensator))

    assert config.axes["x"].compensator.identifier == identifier


def test_unknown_key_beside_a_gain_has_a_suggestion(problems_of: ProblemsOf) -> None:
    """The identifier that the gain implies does not hide the known keys."""
    assert problems_of((COMPENSATOR, "lms_gain: 0.1, creeps: true")) == [
        "test.yaml:12:34: axes.x.compensator.creeps: unknown key, did you mean 'creep'?"
    ]


def test_creep_needs_least_squares(problems_of: ProblemsOf, load: Load) -> None:
    """LMS would ignore it."""
    creep = (COMPENSATOR, "creep: true")
    assert load(creep).axes["x"].compensator.creep

    assert problems_of(creep, ("method: least-squares", "method: lms")) == [
        "test.yaml:12:26: axes.x.compensator.creep: lms cannot identify creep, leave it out or "
        "use method least-squares"
    ]


def test_bounds_off_by_rounding_are_allowed(load: Load) -> None:
    """A sum that exceeds its limit by rounding alone is accepted."""
    levels = (2.6, 10.4, 13.0, 1e-14)
    parts = ", ".join(f"{{kind: setpoint, level: {level}}}" for level in levels)
    command = f"{{kind: sum, parts: [{parts}]}}"

    assert load(("{kind: triangle, low: 0, high: 25, frequency_hz: 0.5}", command)).cases


def test_devices_made_in_python() -> None:
    """In Python, options are an instance of the driver's model; a mapping cannot be checked."""
    options = LimitsConfig(drive_min_v=0, drive_max_v=1, slew_v_per_s=1, rest_v=0)

    assert options is DeviceConfig(driver="any", options=options).options
    with pytest.raises(ValidationError, match="instance of the driver's own model"):
        DeviceConfig.model_validate({"driver": "any", "options": {}})


def test_missing_file_names_the_file(tmp_path: Path) -> None:
    """A missing file is a configuration error."""
    with pytest.raises(ConfigError, match=r"none\.yaml: cannot be read: No such file"):
        load_experiment(tmp_path / "none.yaml", registry)


def test_reading_a_configuration_needs_no_numerics() -> None:
    """The package imports neither numpy nor numba, so that checking a file starts quickly."""
    code = "import sys, piezod.config.experiment; print({'numpy', 'numba'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout == "set()\n"
