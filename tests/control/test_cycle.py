"""One cycle: what happens in it, in which order, and what a refused write leaves behind."""

from collections.abc import Container, Sequence

import pytest

from piezod.control.cycle import Cycle
from piezod.control.guard import Guard, Limits
from piezod.control.law.axis import AxisOutput
from piezod.devices.interface import Sample
from tests.control.fakes import MS, FakeAmplifier, FakeAxis, FakeSensor

GUARD = Guard([Limits(0.0, 150.0, 5000.0)] * 2, longest_s=2e-3)


class Doubter:
    """Uses no sample at all."""

    sent_v: Sequence[float] | None = None
    eased: Container[int] = ()

    def watch(self, t_ns: int, samples: Sequence[Sample]) -> Sequence[Sample]:
        """Call each sample invalid."""
        return [Sample(t_ns, float("nan"), False) for _ in samples]


def two_axes() -> tuple[list[str], FakeAmplifier, Cycle]:
    """Return what happens, an amplifier, and a cycle of two axes that ask for 3 V and 4 V."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True), Sample(0, 2.5, valid=True)])
    amplifier = FakeAmplifier(log)
    axes = [FakeAxis(log, "x", 3.0), FakeAxis(log, "y", 4.0)]
    return log, amplifier, Cycle(sensor, amplifier, axes, GUARD, 1e-3)


def test_cycle_reads_updates_writes_and_tells_the_axes() -> None:
    """The order is the way of a sample, and all axes are written in one transaction."""
    log, _, cycle = two_axes()

    cycle.run(7 * MS)

    assert log == [
        "read at 7000000",
        "x updates at 7000000 with 1.5 µm",
        "y updates at 7000000 with 2.5 µm",
        "write [3.0, 4.0] at 7000000",
        "x has 3.0 V",
        "y has 4.0 V",
    ]


def test_record_holds_what_happened() -> None:
    """Samples and outputs are in the order of the axes."""
    _, _, cycle = two_axes()

    record = cycle.run(7 * MS)

    assert record.t_ns == 7 * MS
    assert [sample.position_um for sample in record.samples] == [1.5, 2.5]
    assert [output.drive_v for output in record.outputs] == [3.0, 4.0]
    assert record.written


def test_refused_write_leaves_the_voltage_in_force() -> None:
    """The axes are not told of voltages that the amplifier did not take."""
    log, amplifier, cycle = two_axes()
    amplifier.refuses = True

    record = cycle.run(7 * MS)

    assert not record.written
    assert log[-1] == "write [3.0, 4.0] at 7000000"


def test_cycle_goes_on_after_a_refused_write() -> None:
    """A fault is a value: the next cycle writes again."""
    log, amplifier, cycle = two_axes()
    amplifier.refuses = True
    cycle.run(7 * MS)
    amplifier.refuses = False

    assert cycle.run(8 * MS).written
    assert log[-2:] == ["x has 3.0 V", "y has 4.0 V"]


def test_sensor_with_a_sample_too_few_is_a_mistake() -> None:
    """An axis without a sample is not passed over in silence."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True)])
    axes = [FakeAxis(log, "x", 3.0), FakeAxis(log, "y", 4.0)]

    with pytest.raises(ValueError, match="shorter"):
        Cycle(sensor, FakeAmplifier(log), axes, GUARD, 1e-3).run(0)


def test_the_guard_is_the_last_thing_before_the_write() -> None:
    """What an axis asks for is cut to what the limits allow, and nothing else is written."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True), Sample(0, 2.5, valid=True)])
    axes = [FakeAxis(log, "x", float("nan")), FakeAxis(log, "y", 400.0)]
    cycle = Cycle(sensor, FakeAmplifier(log), axes, GUARD, 1e-3)

    record = cycle.run(0)

    assert record.admitted.drive_v == [0.0, 5.0]
    assert log[-3:] == ["write [0.0, 5.0] at 0", "x has 0.0 V", "y has 5.0 V"]


def test_cycle_soon_after_a_late_one_may_move_less() -> None:
    """The slew rate holds for the time since the last write, and a pause is not made up for."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True), Sample(0, 2.5, valid=True)])
    axes = [FakeAxis(log, "x", 100.0), FakeAxis(log, "y", 100.0)]
    cycle = Cycle(sensor, FakeAmplifier(log), axes, GUARD, 1e-3)
    instants_ns = (0, MS, int(1.9 * MS), 2 * MS, 9 * MS)

    # What is in force stays 0 V for these axes, so each drive is as far as it may go in one step.
    steps_v = [cycle.run(t_ns).admitted.drive_v[0] for t_ns in instants_ns]

    assert steps_v == pytest.approx([5.0, 5.0, 4.5, 0.5, 5.0])


def test_the_overseer_says_which_samples_are_used() -> None:
    """It stands between reading and compensating."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True)])
    axes = [FakeAxis(log, "x", 3.0)]

    one = Guard([Limits(0.0, 150.0, 5000.0)], longest_s=2e-3)
    record = Cycle(sensor, FakeAmplifier(log), axes, one, 1e-3, Doubter()).run(0)

    assert not record.samples[0].valid


class Stale(FakeAxis):
    """Answers with what it made for the cycle before."""

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Ask for a voltage of another cycle."""
        return super().update(t_ns, sample)._replace(t_ns=t_ns - MS)


def test_what_was_made_for_another_cycle_is_not_written() -> None:
    """The voltage in force stays."""
    log: list[str] = []
    sensor = FakeSensor(log, [Sample(0, 1.5, valid=True)])
    one = Guard([Limits(0.0, 150.0, 5000.0)], longest_s=2e-3)

    record = Cycle(sensor, FakeAmplifier(log), [Stale(log, "x", 3.0)], one, 1e-3).run(MS)

    assert record.admitted.stale
    assert record.admitted.drive_v == [0.0]


class Unacknowledged(Doubter):
    """Knows of a voltage that was sent and not acknowledged."""

    sent_v: Sequence[float] | None = (5.0,)


def test_what_follows_an_unacknowledged_write_is_near_to_both() -> None:
    """From 0 V on, where 5 V may be in force or not, one step leads to 0 to 5 V only."""
    for asked_v, written_v in ((-9.0, 0.0), (3.0, 3.0), (99.0, 5.0)):
        log: list[str] = []
        sensor = FakeSensor(log, [Sample(0, 1.5, valid=True)])
        one = Guard([Limits(-150.0, 150.0, 5000.0)], longest_s=2e-3)
        axes = [FakeAxis(log, "x", asked_v)]
        record = Cycle(sensor, FakeAmplifier(log), axes, one, 1e-3, Unacknowledged()).run(0)

        assert record.admitted.drive_v == [written_v]
