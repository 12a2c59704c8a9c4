"""A stage without a loop goes to its safe voltage, whatever its amplifiers do."""

from itertools import pairwise
from math import isnan
from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.control.guard import read_back_tolerance_v
from piezod.daemon.last_output import stays
from piezod.daemon.safe.ramp import AxisOutcome
from piezod.daemon.safe.ramp_down import Noted, ramp_down
from piezod.devices import registry
from piezod.devices.interface import Identity
from piezod.errors import DeviceError
from piezod.testing.fake_clock import FakeClock
from piezod.units import NS_PER_S
from tests.daemon.daemons import configuration
from tests.daemon.fake_amplifier import FakeAmplifier, plugin_of, stage_of


class Bench:
    """Amplifiers, made before the driver is asked for them, and a clock.

    Each axis is given by its amplifier and its safe voltage.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **axes: tuple[str, float]) -> None:
        served: dict[str, list[str]] = {}
        for axis, (amplifier, _) in axes.items():
            served.setdefault(amplifier, []).append(axis)
        self.amplifiers = {name: FakeAmplifier(tuple(each)) for name, each in served.items()}
        by_axes = {each.axes: each for each in self.amplifiers.values()}
        plugin = plugin_of(by_axes.__getitem__)
        monkeypatch.setattr(registry, "names", lambda: ("fake",))
        monkeypatch.setattr(registry, "load", lambda _name: plugin)
        self.config = stage_of(axes)
        self.identities: dict[str, Identity] = {}
        """Identity of each amplifier when the loop opened it."""

    def run(
        self, *, confirmed: bool = False, clean: bool = False, **last_v: float
    ) -> dict[str, AxisOutcome]:
        """Ramp down; the amplifiers are closed at the end."""
        noted = Noted(last_v, self.identities, clean)
        clock = FakeClock(NS_PER_S)
        outcomes = ramp_down(self.config, noted, 5.0, clock, confirmed=confirmed)
        assert all(amplifier.closed for amplifier in self.amplifiers.values())
        return outcomes


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a stage of one axis whose safe voltage is 10 V, at 75 V."""
    return Bench(monkeypatch, x=("amp", 10.0))


def test_axis_ramps_from_the_voltage_read_back(bench: Bench) -> None:
    """The ramp keeps to its rate and ends at the safe voltage, which is read back."""
    outcomes = bench.run(x=75.0)
    points = [(NS_PER_S, [75.0]), *bench.amplifiers["amp"].writes]
    speeds = [abs(v[0] - u[0]) / (t - s) * NS_PER_S for (s, u), (t, v) in pairwise(points[1:])]

    assert outcomes == {"x": AxisOutcome(75.0, False, 10.0, 10.0, "", 10.0)}
    assert abs(points[1][1][0] - 75.0) <= 0.5
    assert max(speeds) <= 50


def test_read_back_unlike_the_last_write_is_left_to_a_person(bench: Bench) -> None:
    """Without a sensor nothing tells which of them is right; a person may answer for the first."""
    left = bench.run(x=3.0)["x"]
    written = list(bench.amplifiers["amp"].writes)
    confirmed = bench.run(x=3.0, confirmed=True)["x"]

    assert "read-back 75 V, last write 3 V" in left.why
    assert (written, isnan(left.from_v), left.read_back_v) == ([], True, 75.0)
    assert (confirmed.why, confirmed.from_v) == ("", 75.0)


@pytest.mark.parametrize("last_v", [70.5, 72.0, 77.0, 79.5, 60.0, 90.0])
def test_first_write_is_a_step_from_read_back_and_last_write(bench: Bench, last_v: float) -> None:
    """Either of them may be in force. If they are too far apart for that, nothing is written."""
    axis = bench.config.axes["x"].limits
    step_v = axis.slew_v_per_s / bench.config.rate_hz
    step_v += read_back_tolerance_v(axis.drive_min_v, axis.drive_max_v)
    outcome, written = bench.run(x=last_v)["x"], bench.amplifiers["amp"].writes

    far = abs(last_v - 75.0) > step_v
    assert ("do not agree" in outcome.why and "--confirm-output" in outcome.why) is far
    for _, (first_v,) in written[:1]:
        assert max(abs(first_v - 75.0), abs(first_v - last_v)) <= step_v
    assert bool(written) is not far
    assert (outcome.why == "") is not far


@pytest.mark.parametrize(
    ("slew_v_per_s", "rate_hz", "ramp_v_per_s"),
    [(400, 20, 50), (2000, 200, 20), (20_000, 1000, 50), (20_000, 200, 200), (200, 1000, 200)],
)
@pytest.mark.parametrize("ahead_v", [-50.0, -17.0, -9.0, -5.0, -0.9, 0.9, 2.0, 5.0, 9.0, 30.0])
def test_note_ahead_of_the_output_is_ramped_or_refused(
    bench: Bench, slew_v_per_s: float, rate_hz: float, ramp_v_per_s: float, ahead_v: float
) -> None:
    """It is ramped at once within a step of the loop, and refused with the numbers beyond one."""
    axis = bench.config.axes["x"]
    limits = axis.limits.model_copy(update={"slew_v_per_s": slew_v_per_s})
    safety = axis.safety.model_copy(update={"ramp_v_per_s": ramp_v_per_s})
    x = axis.model_copy(update={"limits": limits, "safety": safety})
    bench.config = bench.config.model_copy(update={"rate_hz": rate_hz, "axes": {"x": x}})
    amplifier = bench.amplifiers["amp"]
    outcome = bench.run(x=75.0 + ahead_v)["x"]
    step_v = slew_v_per_s / rate_hz

    assert bool(amplifier.writes) is (outcome.why == "")
    assert outcome.why == "" or all(
        each in outcome.why for each in (f"{75.0 + ahead_v:.4g} V", "75 V", "--confirm-output")
    )
    assert outcome.why == "" or abs(ahead_v) > min(step_v, 7.0) + 0.7
    assert outcome.why or abs(ahead_v) <= min(step_v, 10.0) + 0.7
    assert outcome.why or abs(amplifier.writes[0][1][0] - 75.0) <= step_v + 0.7


@pytest.mark.parametrize("clean", [True, False])
@pytest.mark.parametrize("kind", ["does not hold", "watchdog"])
def test_amplifier_that_has_gone_to_rest_by_itself_is_ramped(
    monkeypatch: pytest.MonkeyPatch, kind: str, *, clean: bool
) -> None:
    """After an end in order nothing contradicts it; after a crash only a watchdog explains it."""
    bench = Bench(monkeypatch, x=("amp", 75.0))
    amplifier = bench.amplifiers["amp"]
    amplifier.holds, amplifier.watchdog = kind == "watchdog", kind == "watchdog"
    amplifier.drive_v = [0.0]
    outcome = bench.run(x=75.0, clean=clean)["x"]

    assert (outcome.why == "") is (clean or kind == "watchdog")
    assert max(amplifier.steps_v, default=0.0) <= 0.5
    assert bool(amplifier.writes) is (outcome.why == "")


def test_ramp_that_ended_is_no_contradiction_to_the_next_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The amplifier went to rest when the first ramp closed it; the loop's mark is still there."""
    bench = Bench(monkeypatch, x=("amp", 75.0))
    bench.amplifiers["amp"].holds = False
    first = bench.run(x=75.0)["x"]
    again = bench.run(x=first.written_v)["x"]

    assert (first.why, again.why, again.read_back_v) == ("", "", 75.0)


def test_output_that_may_have_gone_to_rest_unseen_is_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without a read-back a write could be a step from rest, unless the last write was there."""
    bench = Bench(monkeypatch, x=("amp", 75.0))
    amplifier = bench.amplifiers["amp"]
    amplifier.holds = amplifier.reads_back = False
    left = bench.run(x=75.0, clean=True)["x"]
    untouched = not amplifier.writes
    ramped = bench.run(x=0.0, clean=True)["x"]

    assert untouched and "reports no voltage" in left.why
    assert ramped.why == ""


def test_all_waits_of_a_ramp_together_last_half_a_minute(bench: Bench) -> None:
    """An output that follows now and then does not keep the ramp alive for ever."""
    amplifier = bench.amplifiers["amp"]
    amplifier.follows_every_ns = 4 * NS_PER_S
    outcome = bench.run(x=75.0)["x"]

    assert "the voltage stays" in outcome.why
    assert (amplifier.read_ns - NS_PER_S) / NS_PER_S < 35.0


def test_nothing_is_called_written_that_was_not(bench: Bench) -> None:
    """An output that leaves the start before the first write is reported as that."""
    amplifier = bench.amplifiers["amp"]
    amplifier.silent_until_ns = 2 * NS_PER_S + 15_000_000
    outcome = bench.run(x=110.0)["x"]

    assert amplifier.writes == []
    assert "nothing was written" in outcome.why and "V written" not in outcome.why
    assert "--confirm-output" in outcome.why


def test_fall_by_the_watchdog_of_the_device_is_believed(bench: Bench) -> None:
    """Nobody has written for a while; a rise has no such reason."""
    bench.amplifiers["amp"].watchdog = True
    fallen = bench.run(x=110.0)["x"]
    bench.amplifiers["amp"].drive_v = [75.0]
    risen = bench.run(x=40.0)["x"]

    assert (fallen.why, fallen.from_v) == ("", 75.0)
    assert "do not agree" in risen.why


@pytest.mark.parametrize("stuck_s", [5.0, 100.0])
def test_output_that_does_not_follow_is_waited_for(bench: Bench, stuck_s: float) -> None:
    """No write is farther from the read-back than ten steps, and after half a minute it is over."""
    amplifier = bench.amplifiers["amp"]
    amplifier.stuck_until_ns = NS_PER_S + int(stuck_s * NS_PER_S)
    outcome = bench.run(x=75.0)["x"]
    waited_s = (amplifier.read_ns - NS_PER_S) / NS_PER_S

    assert max(amplifier.steps_v) <= 5.0 + 0.7
    assert ("the voltage stays" in outcome.why) is (stuck_s > 30.0)
    assert (amplifier.drive_v == [10.0]) is (stuck_s < 30.0)
    assert waited_s < 40.0


def test_output_that_drops_out_is_not_written_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A write sets both axes of an amplifier: the other one waits, too."""
    bench = Bench(monkeypatch, x=("amp", 0.0), y=("amp", 0.0))
    amplifier = bench.amplifiers["amp"]
    amplifier.drops_at_v = 60.0
    outcomes = bench.run(x=75.0, y=75.0)

    assert "the voltage stays" in outcomes["x"].why
    assert max(amplifier.steps_v) <= 5.0 + 0.7


def test_axis_outside_its_range_comes_back(bench: Bench) -> None:
    """A voltage beyond the limits of the axis is ramped down too."""
    bench.amplifiers["amp"].drive_v = [130.0]

    assert bench.run()["x"].why == ""
    assert bench.amplifiers["amp"].drive_v == [10.0]


@pytest.mark.parametrize(("drive_v", "safe"), [(120.8, True), (125.0, False)])
def test_axis_a_little_beyond_the_limits_is_set_to_the_limit(
    bench: Bench, drive_v: float, *, safe: bool
) -> None:
    """Farther away, that would be a jump, and the voltage is unknown."""
    amplifier = bench.amplifiers["amp"]
    amplifier.drive_v, amplifier.highest_v = [drive_v], 120.0
    outcome = bench.run()["x"]

    assert (outcome.why == "") is safe
    assert [written for _, (written,) in amplifier.writes][:1] == ([120.0] if safe else [])
    assert safe or outcome.why == "the amplifier refuses 124.50 V"


WHO = Identity("piezod", "fake", "0", "0")


@pytest.mark.parametrize("part", ["maker", "model", "serial"])
def test_another_amplifier_is_left_alone(bench: Bench, part: str) -> None:
    """Another amplifier is neither activated nor written to."""
    bench.identities["amp"] = WHO._replace(**{part: "other"})
    outcome = bench.run(x=75.0)["x"]

    assert outcome.why.startswith("it is another device: piezod fake 0, expected: ")
    assert bench.amplifiers["amp"].writes == []
    assert not bench.amplifiers["amp"].activated


def test_the_same_amplifier_with_other_firmware_is_ramped(bench: Bench) -> None:
    """The firmware does not belong to the identity."""
    bench.identities.update(amp=WHO._replace(firmware="1"), other=WHO._replace(serial="1"))

    assert bench.run()["x"].why == ""


def test_axis_at_its_safe_voltage_stays(bench: Bench) -> None:
    """The safe voltage is written once."""
    bench.amplifiers["amp"].drive_v = [10.0]

    assert bench.run()["x"].why == ""
    assert [drive_v for _, drive_v in bench.amplifiers["amp"].writes] == [[10.0]]


def test_amplifier_without_read_back_starts_from_the_last_write(bench: Bench) -> None:
    """The outcome says so, and has no read-back voltage."""
    bench.amplifiers["amp"].reads_back = False
    outcome = bench.run(x=75.0)["x"]

    assert (outcome.from_v, outcome.from_noted, outcome.why) == (75.0, True, "")
    assert isnan(outcome.read_back_v)
    assert bench.amplifiers["amp"].drive_v == [10.0]


def test_amplifier_without_read_back_starts_where_a_person_has_seen_it(bench: Bench) -> None:
    """That is the safe voltage, whatever was written last: no step up after a loss of power."""
    amplifier = bench.amplifiers["amp"]
    amplifier.reads_back, amplifier.drive_v = False, [10.0]
    outcome = bench.run(x=75.0, confirmed=True)["x"]

    assert [drive_v for _, drive_v in amplifier.writes] == [[10.0]]
    assert (outcome.why, outcome.written_v) == ("", 10.0)


def test_silent_amplifier_starts_from_the_last_write(bench: Bench) -> None:
    """An amplifier that should read back and does not is ramped, but is not safe."""
    bench.amplifiers["amp"].silent = True
    outcome = bench.run(x=75.0)["x"]

    assert "nan V read back" in outcome.why
    assert bench.amplifiers["amp"].drive_v == [10.0]


@pytest.mark.parametrize("reads_back", [True, False])
def test_unknown_voltage_is_left_alone(bench: Bench, *, reads_back: bool) -> None:
    """Without a read-back and a last write, nothing is written."""
    bench.amplifiers["amp"].reads_back = reads_back
    bench.amplifiers["amp"].silent = True
    outcome = bench.run()["x"]

    assert "no last write is stored" in outcome.why
    assert bench.amplifiers["amp"].writes == []


def test_amplifier_that_refuses_is_unknown(bench: Bench) -> None:
    """The outcome has the refused voltage."""
    bench.amplifiers["amp"].refuses = True

    assert bench.run()["x"].why == "the amplifier refuses 74.50 V"


def test_amplifier_that_is_stuck_is_unknown(bench: Bench) -> None:
    """An amplifier that accepts writes and does not follow is detected."""
    bench.amplifiers["amp"].stuck = True

    assert "75.00 V read back" in bench.run()["x"].why


def test_absent_amplifier_is_waited_for(bench: Bench) -> None:
    """An amplifier that another process still holds is opened as soon as possible."""
    bench.amplifiers["amp"].absent = 100

    assert bench.run()["x"].why == ""


def test_amplifier_that_stays_away_is_unknown(bench: Bench) -> None:
    """After the wait, the outcome has the message of the driver."""
    bench.amplifiers["amp"].absent = 1_000_000

    assert bench.run()["x"].why == "it is away"


@pytest.mark.parametrize("error", [DeviceError("it answers in Morse"), OSError("in Morse")])
def test_amplifier_whose_driver_fails_is_unknown(bench: Bench, error: Exception) -> None:
    """Any exception of a driver is an outcome, without a second attempt."""
    bench.amplifiers["amp"].wrong = error

    assert bench.run()["x"].why == str(error)


def test_one_that_fails_leaves_the_others_to_their_ramps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Axes of other amplifiers reach their safe voltages."""
    bench = Bench(monkeypatch, x=("one", 0.0), y=("two", 5.0), z=("one", -10.0))
    bench.amplifiers["two"].refuses = True
    outcomes = bench.run()

    assert [(name, bool(outcome.why)) for name, outcome in outcomes.items()] == [
        ("x", False),
        ("y", True),
        ("z", False),
    ]
    assert bench.amplifiers["one"].drive_v == [0.0, -10.0]


def test_one_that_fails_to_close_does_not_keep_others_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All amplifiers are closed, and every axis has its outcome."""
    bench = Bench(monkeypatch, x=("bad", 10.0), y=("good", 20.0))
    close = bench.amplifiers["bad"].close

    def fail() -> None:
        close()
        raise OSError("closed by the wrong end")

    monkeypatch.setattr(bench.amplifiers["bad"], "close", fail)
    outcomes = bench.run()

    assert [outcomes[axis].why for axis in ("x", "y")] == ["", ""]


def test_voltage_that_rounds_to_zero_has_no_sign(bench: Bench) -> None:
    """A person reads 0.00 V, in the reason and in what stays."""
    amplifier = bench.amplifiers["amp"]
    amplifier.drive_v, amplifier.stuck = [-0.001], True
    outcome = bench.run(x=-0.001)["x"]

    assert "0.00 V read back" in outcome.why
    assert "-0.00" not in outcome.why + stays(-0.001)


def test_stage_with_lines_is_ramped(tmp_path: Path) -> None:
    """Its digital outputs are set with the voltages, its inputs are not read."""
    path = configuration(tmp_path)
    lines = "{a: {device: rig, input: 'line:camera'}, b: {device: rig, output: 'line:1'}}"
    with path.open("a", encoding="utf-8") as file:
        file.write(f"\nlines: {lines}\n")
    config = load_daemon(path, registry)
    (outcome,) = ramp_down(config, Noted({}, {}), 1.0, FakeClock(0), confirmed=True).values()

    assert (outcome.why, outcome.written_v) == ("", 0.0)
