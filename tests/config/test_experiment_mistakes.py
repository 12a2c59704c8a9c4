"""The exact text for each mistake in an experiment file."""

from collections.abc import Callable

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.waveforms.combined import KINDS

ProblemsOf = Callable[..., list[str]]
RANGE = "    command_range_um: [0, 26]"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "    sensor: rig\n",
            "",
            "7:3: axes.x: needs a `sensor`: an experiment measures the errors of each axis",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: fast",
            "1:10: rate_hz: must be a number (got 'fast'), allowed range 10 to 20000 Hz",
        ),
        ("rate_hz: 1000", "rate_hz: yes", "1:10: rate_hz: must be a number (got 'yes')"),
        ("rate_hz: 1000", "rate_hz: true", "1:10: rate_hz: must be a number (got true)"),
        ("rate_hz: 1000", "rate_hz: '1000'", "1:10: rate_hz: must be a number (got '1000')"),
        ("rate_hz: 1000", "rate_hz: 1e5", "1:10: rate_hz: out of range (got 100000.0)"),
        ("rate_hz: 1000", "rate_hz: .nan", "1:10: rate_hz: must be a finite number (got .nan)"),
        ("rate_hz: 1000", "rate_hz: -.inf", "1:10: rate_hz: must be a finite number (got -.inf)"),
        ("rate_hz: 1000", "rate_hz:", "1:9: rate_hz: must be a number (got nothing)"),
        ("rate_hz: 1000", "rate_hz: 1000\nsede: 4", "2:1: sede: unknown key, did you mean 'seed'?"),
        (
            "rest_v: 0",
            "rest_v: 0, q: 1",
            "10:80: axes.x.limits.q: unknown key, known keys: drive_min_v, drive_max_v",
        ),
        (", rest_v: 0", "", "10:5: axes.x.limits.rest_v: required key is missing"),
        (
            "operators: 19",
            "operators: 19.0",
            "12:30: axes.x.compensator.operators: must be a whole number (got 19.0)",
        ),
        ("operators: 19", "delay_s: aut", "12:28: axes.x.compensator.delay_s: unknown value"),
        ("operators: 19", "delay_s: -1", "12:28: axes.x.compensator.delay_s: out of range"),
        (
            "operators: 19",
            "delay_s: -0.05",
            "12:28: axes.x.compensator.delay_s: out of range for the operators of least-squares",
        ),
        (
            "[0, 26]",
            "[26, 0]",
            "11:28: axes.x.command_range_um[1]: must be above the first of the two",
        ),
        ("[0, 26]", "[26]", "11:5: axes.x.command_range_um[1]: required entry is missing"),
        ("[0, 26]", "26", "11:23: axes.x.command_range_um: must be a list (got 26)"),
        ("least-squares", "exact", "14:11: identification.method: unknown value"),
        ("[feedforward, adaptive]", "[adaptiv]", "18:9: modes[0]: unknown value (got 'adaptiv')"),
        ("[feedforward, adaptive]", "[adaptive, adaptive]", "18:19: modes[1]: appears twice"),
        ("[feedforward, adaptive]", "[]", "18:8: modes: too few entries"),
        ("[feedforward, adaptive]", "adaptive", "18:8: modes: must be a list (got 'adaptive')"),
        ("name: case 1", "name: ''", "20:11: cases[0].name: too short (got '')"),
        (
            "duration_s: 20",
            "duration_s: 2",
            "22:17: cases[0].duration_s: must be longer than period_s, 2 s (got 2 s)",
        ),
        (
            "    command_um: {kind: triangle, low: 0, high: 25, frequency_hz: 0.5}",
            "    command_um: 5",
            "23:17: cases[0].command_um: must be a mapping, lines of `key: value` (got 5)",
        ),
        ("kind: triangle", "kind: triangel", "23:24: cases[0].command_um.kind: unknown value"),
        ("kind: triangle, ", "", "23:5: cases[0].command_um: required key 'kind' is missing"),
        ("high: 25", "high: 30", "23:5: cases[0].command_um: may exceed the range of axis x"),
        ("high: 148", "high: 151", "17:3: identification.drive_v: may exceed the range of axis x"),
        (
            "drive_max_v: 150",
            "drive_max_v: -1",
            "10:43: axes.x.limits.drive_max_v: must be above drive_min_v (got -1 V, drive_min_v",
        ),
        ("rest_v: 0", "rest_v: -0.5", "10:77: axes.x.limits.rest_v: out of range (got -0.5 V)"),
        ("sensor: rig", "sensor: rog", "9:13: axes.x.sensor: no such device (got 'rog')"),
        ("sensor: rig", "sensor: Rig-1", "9:13: axes.x.sensor: not well formed"),
        (
            "name: case 1",
            'name: "case\\01"',
            "20:11: cases[0].name: must be one line without control characters (got 'case\\x001')",
        ),
        (
            "period_s: 2",
            'period_s: 2\n    title: "a\\nb"',
            "22:12: cases[0].title: must be one line without control characters (got 'a\\nb')",
        ),
        (
            "rate_hz: 1000",
            'rate_hz: 1000\ntitle: "a\\Lb"',
            "2:8: title: must be one line without control characters (got 'a\\u2028b')",
        ),
        (
            "rate_hz: 1000",
            'rate_hz: 1000\nreference: "\\e[31m"',
            "2:12: reference: must be one line without control characters (got '\\x1b[31m')",
        ),
        (
            "kind: triangle",
            "kind: [1]",
            "23:24: cases[0].command_um.kind: unknown value (got a list), allowed: "
            + ", ".join(KINDS),
        ),
        (
            "kind: triangle",
            "kind: 1",
            "23:24: cases[0].command_um.kind: unknown value (got 1), allowed: " + ", ".join(KINDS),
        ),
        ("  x:\n", "  X:\n", "7:3: axes.X: not well formed (got 'X')"),
        ("driver: bench", "driver: banch", "4:13: devices.rig.driver: unknown driver"),
        ("driver: bench", "driver: e727", "4:13: devices.rig.driver: unknown driver"),
        ("driver: bench", "driver: 5", "4:13: devices.rig.driver: must be a text (got 5)"),
        (
            "driver: bench",
            "driver: broken",
            "4:13: devices.rig.driver: driver 'broken' cannot be imported: no module named 'acme'",
        ),
        ("variant: stack", "variant: stak", "5:24: devices.rig.options.variant: unknown value"),
        (
            "gain: 2.5",
            "gain: 0",
            "5:37: devices.rig.options.gain: too small (got 0), allowed: more than 0.0",
        ),
        (
            "gain: 2.5",
            "gain: 11",
            "5:37: devices.rig.options.gain: too large (got 11), allowed: at most 10.0",
        ),
        ("gain: 2.5", "gian: 2", "5:31: devices.rig.options.gian: unknown key"),
        (
            "{variant: stack, gain: 2.5}",
            "[stack]",
            "5:14: devices.rig.options: must be a mapping, lines of `key: value` (got a list)",
        ),
    ],
)
def test_one_mistake(problems_of: ProblemsOf, old: str, new: str, expected: str) -> None:
    """Each mistake gives one line, which begins with its place and says what is wrong there."""
    (problem,) = problems_of((old, new))

    assert problem.startswith(f"test.yaml:{expected}")


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("first_mode: {frequency_hz: 734}", "5: axes.x.first_mode.damping: required key"),
        ("first_mode: {damping: 0.1}", "5: axes.x.first_mode.frequency_hz: required key"),
        (
            "first_mode: {frequency_hz: 0.5, damping: 0.1}",
            "32: axes.x.first_mode.frequency_hz: out of range (got 0.5), allowed range 1 to 100000",
        ),
        ("first_mode: {frequency_hz: 734, damping: 0}", "46: axes.x.first_mode.damping: out of"),
        ("trim: {base: trimmed}", "18: axes.x.trim.base: unknown value (got 'trimmed'), allowed:"),
        ("trim: {gain_per_s: 0}", "24: axes.x.trim.gain_per_s: out of range (got 0), allowed"),
        ("trim: {authority_pct: 21}", "27: axes.x.trim.authority_pct: out of range (got 21)"),
    ],
)
def test_one_mistake_in_a_key_of_an_axis(problems_of: ProblemsOf, key: str, expected: str) -> None:
    """Keys that the experiment of these tests does not have."""
    (problem,) = problems_of((RANGE, f"{RANGE}\n    {key}"))

    assert problem.startswith(f"test.yaml:12:{expected}")


SURFACE = [("method: least-squares", "method: surface"), (", lms_gain: 0.1", "")]


@pytest.mark.parametrize(
    ("key", "value", "own"),
    [
        ("operators", "19", "operators"),
        ("thresholds", "graded", "thresholds"),
        ("deadband_pct", "0.05", "dead-band"),
    ],
)
def test_surface_refuses_the_keys_of_stops(
    problems_of: ProblemsOf, key: str, value: str, own: str
) -> None:
    """A key that a surface does not use is an error, with its place and what to do."""
    assert problems_of(*SURFACE, ("operators: 19", f"{key}: {value}")) == [
        f"test.yaml:12:{28 - len('delay_s') + len(key)}: axes.x.compensator.{key}: not used, a "
        f"surface has no {own}, leave it out or use method least-squares (method surface uses "
        "creep, identifier, learned_pct, delay_s, sensor_delay_s)"
    ]


def test_surface_takes_its_own_keys(load: Callable[..., ExperimentConfig]) -> None:
    """Creep, identifier rls and delays, also a negative one, belong to a surface."""
    settings = "creep: true, identifier: rls, delay_s: -0.0004, sensor_delay_s: 0.0006"

    experiment = load(*SURFACE, ("operators: 19", settings))

    assert experiment.axes["x"].compensator.delay_s == -0.0004


def test_surface_refuses_the_identifiers_of_the_paper(problems_of: ProblemsOf) -> None:
    """They learn the weights of stop operators; a gain alone means lms, too."""
    assert problems_of(*SURFACE, ("operators: 19", "lms_gain: 0.1")) == [
        "test.yaml:12:5: axes.x.compensator: identifier lms learns the weights of stop operators, "
        "use identifier rls without lms_gain, or method least-squares"
    ]


def test_length_of_the_identification_of_a_surface(problems_of: ProblemsOf) -> None:
    """A surface has 24 weights, whatever the number of operators would be."""
    short = ("duration_s: 30", "duration_s: 0.1"), ("operators: 19", "creep: true")

    (problem,) = problems_of(*SURFACE, *short)

    assert "too short for the 24 weights of axis x at 1000 Hz (got 0.1 s)" in problem
