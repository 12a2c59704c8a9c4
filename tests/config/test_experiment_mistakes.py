"""The exact text for each mistake in an experiment file."""

from collections.abc import Callable

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.waveforms.combined import KINDS

ProblemsOf = Callable[..., list[str]]


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
        (
            "rate_hz: 1000",
            "rate_hz: yes",
            "1:10: rate_hz: must be a number (got 'yes'), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: true",
            "1:10: rate_hz: must be a number (got true), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: '1000'",
            "1:10: rate_hz: must be a number (got '1000'), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: 1e5",
            "1:10: rate_hz: out of range (got 100000.0), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: .nan",
            "1:10: rate_hz: must be a finite number (got .nan), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: -.inf",
            "1:10: rate_hz: must be a finite number (got -.inf), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz:",
            "1:9: rate_hz: must be a number (got nothing), allowed range 10 to 20000 Hz",
        ),
        (
            "rate_hz: 1000",
            "rate_hz: 1000\nsede: 4",
            "2:1: sede: unknown key, did you mean 'seed'?",
        ),
        (
            "rest_v: 0",
            "rest_v: 0, q: 1",
            "10:80: axes.x.limits.q: unknown key, known keys: "
            "drive_min_v, drive_max_v, slew_v_per_s, rest_v",
        ),
        (", rest_v: 0", "", "10:5: axes.x.limits.rest_v: required key is missing"),
        (
            "operators: 19",
            "operators: 19.0",
            "12:30: axes.x.compensator.operators: must be a whole number (got 19.0), "
            "allowed range 1 to 200",
        ),
        (
            "operators: 19",
            "delay_s: aut",
            "12:28: axes.x.compensator.delay_s: unknown value (got 'aut'), did you mean 'auto'?",
        ),
        (
            "operators: 19",
            "delay_s: -1",
            "12:28: axes.x.compensator.delay_s: out of range (got -1), allowed range -0.1 to 1 s",
        ),
        (
            "operators: 19",
            "delay_s: -0.05",
            "12:28: axes.x.compensator.delay_s: out of range for the operators of least-squares "
            "(got -0.05 s), allowed range 0 to 1 s; method surface takes a negative delay",
        ),
        (
            "[0, 26]",
            "[26, 0]",
            "11:28: axes.x.command_range_um[1]: must be above the first of the two",
        ),
        ("[0, 26]", "[26]", "11:5: axes.x.command_range_um[1]: required entry is missing"),
        ("[0, 26]", "26", "11:23: axes.x.command_range_um: must be a list (got 26)"),
        (
            "least-squares",
            "exact",
            "14:11: identification.method: unknown value (got 'exact'), "
            "allowed: lms, least-squares, surface",
        ),
        (
            "[feedforward, adaptive]",
            "[adaptiv]",
            "18:9: modes[0]: unknown value (got 'adaptiv'), did you mean 'adaptive'?",
        ),
        (
            "[feedforward, adaptive]",
            "[adaptive, adaptive]",
            "18:19: modes[1]: appears twice (got 'adaptive')",
        ),
        (
            "[feedforward, adaptive]",
            "[]",
            "18:8: modes: too few entries (got 0), allowed: at least 1",
        ),
        ("[feedforward, adaptive]", "adaptive", "18:8: modes: must be a list (got 'adaptive')"),
        (
            "name: case 1",
            "name: ''",
            "20:11: cases[0].name: too short (got ''), allowed: at least 1 characters",
        ),
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
        (
            "kind: triangle",
            "kind: triangel",
            "23:24: cases[0].command_um.kind: unknown value (got 'triangel'), "
            "did you mean 'triangle'?",
        ),
        ("kind: triangle, ", "", "23:5: cases[0].command_um: required key 'kind' is missing"),
        (
            "high: 25",
            "high: 30",
            "23:5: cases[0].command_um: may exceed the range of axis x (got 0 to 30 µm), "
            "allowed range 0 to 26 µm",
        ),
        (
            "high: 148",
            "high: 151",
            "17:3: identification.drive_v: may exceed the range of axis x (got 0 to 151 V), "
            "allowed range 0 to 150 V",
        ),
        (
            "drive_max_v: 150",
            "drive_max_v: -1",
            "10:43: axes.x.limits.drive_max_v: must be above drive_min_v "
            "(got -1 V, drive_min_v is 0 V)",
        ),
        (
            "rest_v: 0",
            "rest_v: -0.5",
            "10:77: axes.x.limits.rest_v: out of range (got -0.5 V), allowed range 0 to 150 V",
        ),
        (
            "sensor: rig",
            "sensor: rog",
            "9:13: axes.x.sensor: no such device (got 'rog'), did you mean 'rig'?",
        ),
        (
            "sensor: rig",
            "sensor: Rig-1",
            "9:13: axes.x.sensor: not well formed (got 'Rig-1'), allowed pattern ^[a-z][a-z0-9_]*$",
        ),
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
        (
            "  x:\n",
            "  X:\n",
            "7:3: axes.X: not well formed (got 'X'), allowed pattern ^[a-z][a-z0-9_]*$",
        ),
        (
            "driver: bench",
            "driver: banch",
            "4:13: devices.rig.driver: unknown driver (got 'banch'), did you mean 'bench'?",
        ),
        (
            "driver: bench",
            "driver: e727",
            "4:13: devices.rig.driver: unknown driver (got 'e727'), known: bench, broken, port",
        ),
        ("driver: bench", "driver: 5", "4:13: devices.rig.driver: must be a text (got 5)"),
        (
            "driver: bench",
            "driver: broken",
            "4:13: devices.rig.driver: driver 'broken' cannot be imported: no module named 'acme'",
        ),
        (
            "variant: stack",
            "variant: stak",
            "5:24: devices.rig.options.variant: unknown value (got 'stak'), did you mean 'stack'?",
        ),
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
        (
            "gain: 2.5",
            "gian: 2",
            "5:31: devices.rig.options.gian: unknown key, did you mean 'gain'?",
        ),
        (
            "{variant: stack, gain: 2.5}",
            "[stack]",
            "5:14: devices.rig.options: must be a mapping, lines of `key: value` (got a list)",
        ),
    ],
)
def test_one_mistake(problems_of: ProblemsOf, old: str, new: str, expected: str) -> None:
    """Each mistake gives one line with the place and the allowed values."""
    assert [f"test.yaml:{expected}"] == problems_of((old, new))


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
