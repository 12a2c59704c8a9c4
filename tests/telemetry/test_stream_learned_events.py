"""Tests of setpoint stream, learned parameters and events."""

from math import isnan, nan

import numpy as np

from piezod.telemetry.events import EventReader, EventWriter
from piezod.telemetry.layout import EVENT_SLOTS, MAX_WEIGHTS
from piezod.telemetry.learned import LearnedReader
from piezod.telemetry.learned_writer import LearnedWriter
from piezod.telemetry.record import StageEvent
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.stream import StreamReader, StreamWriter


def event(number: int, text: str = "text") -> StageEvent:
    """Return an event."""
    return StageEvent(number, "info", "state", text, "S5", "x", 1.5, nan)


def test_newest_setpoint_wins(shared: SharedMap) -> None:
    """Of several setpoints in one cycle the loop gets the newest, once."""
    writer, reader = StreamWriter(shared), StreamReader(shared)
    writer.set(1, 1.0, 10)
    writer.set(1, 2.0, 20)

    assert reader.take() == [(1, 2.0, 20)]
    assert reader.take() == []


def test_repeated_setpoint_is_new(shared: SharedMap) -> None:
    """It shows that the stream continues."""
    writer, reader = StreamWriter(shared), StreamReader(shared)
    writer.set(0, 1.0, 10)
    reader.take()

    writer.set(0, 1.0, 10)

    assert reader.take() == [(0, 1.0, 10)]


def test_half_written_setpoint_comes_with_the_next_call(shared: SharedMap) -> None:
    """The loop neither takes half a setpoint nor waits for it."""
    writer, reader = StreamWriter(shared), StreamReader(shared)
    words = shared.part("streams").cast("q")
    writer.set(0, 1.0, 10)
    words[0] += 1  # the writer has begun the next

    taken = reader.take()
    words[3] += 1  # and has ended it

    assert taken == []
    assert len(reader.take()) == 1


def test_learned_parameters_are_complete(shared: SharedMap) -> None:
    """Each axis has as many weights as were published."""
    writer, reader = LearnedWriter(shared), LearnedReader(shared)
    before = reader.read(0)

    writer.publish(0, (np.arange(MAX_WEIGHTS) / 7, 1.0, 2.0, 3.0, False, 0.0, -1.0, 9.0))
    writer.publish(1, ([0.5], 0.0, 1.0, 0.0, False, 0.0, -1.0, 9.0))
    writer.publish(0, (np.arange(38) / 3, 4.0, 5.0, 6.0, True, 0.03, -1.0, 9.0))

    first, second = reader.read(0), reader.read(1)
    assert before is None
    assert first is not None
    assert second is not None
    assert np.array_equal(first.weights, np.arange(38) / 3)
    assert first[1:] == (4.0, 5.0, 6.0, True, 0.03, -1.0, 9.0)
    assert (list(second.weights), second.surface) == ([0.5], False)


def test_half_written_parameters_are_not_returned(shared: SharedMap) -> None:
    """If the writer dies during a write, there are none."""
    LearnedWriter(shared).publish(0, ([1.0], 0.0, 1.0, 0.0, False, 0.0, -1.0, 9.0))
    shared.part("learned").cast("q")[0] += 1

    assert LearnedReader(shared).read(0) is None


def test_event_is_read_as_written(shared: SharedMap) -> None:
    """Events have all their fields and keep their order."""
    writer, reader = EventWriter(shared), EventReader(shared)
    for number in (1, 2):
        writer.append(event(number, "µm: a, b"))

    events, lost = reader.read()

    assert lost == 0
    assert [each.t_ns for each in events] == [1, 2]
    assert events[0][:7] == event(1, "µm: a, b")[:7]
    assert isnan(events[0].limit)
    assert reader.read() == ([], 0)


def test_event_of_the_loop_has_the_fields_of_the_controller() -> None:
    """The loop passes events on unchanged."""
    assert StageEvent._fields == StageEvent._fields


def test_long_text_is_cut_off(shared: SharedMap) -> None:
    """The remaining text is valid."""
    writer, reader = EventWriter(shared), EventReader(shared)
    writer.append(event(1, "µ" * 1000))

    [event_read], _ = reader.read()

    assert set(event_read.text) == {"µ"}
    assert len(event_read.text) > 200


def test_oldest_events_are_overwritten(shared: SharedMap) -> None:
    """A burst never delays the loop; the reader gets the number of lost events."""
    writer, reader = EventWriter(shared), EventReader(shared)
    for number in range(EVENT_SLOTS + 100):
        writer.append(event(number))

    events, lost = reader.read()

    assert len(events) + lost == EVENT_SLOTS + 100
    assert events[-1].t_ns == EVENT_SLOTS + 99
    assert lost == 101
