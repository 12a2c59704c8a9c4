"""Events and adopted models in a recording."""

import json
from math import nan
from pathlib import Path
from typing import Final

import h5py
import pytest

from piezod.config.model_file import dump_model, load_model
from piezod.records.recording.events import MODEL_BYTES, AdoptedModel
from piezod.records.recording.reader import read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.record import StageEvent
from tests.control.rig_stage import shipped_config
from tests.records.telemetry import START_NS, header, record_dtype, records

FAULT: Final = StageEvent(START_NS + 500_000_000, "error", "fault", "3 µm", "S5", "x", 3.0, 2.0)
STATE: Final = StageEvent(START_NS + 700_000_000, "info", "state", "RUN to HOLD", "", "", 0.0, 0.0)
ADOPTED: Final = AdoptedModel(START_NS + 1_000_000_000, "x", "# a model, µm\n")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a recording of 2 s with two events and an adopted model."""
    path = tmp_path / "rec.h5"
    notes = {"configuration": "{}", "model_x": "# the first\n"}
    with TelemetryWriter(path, header(notes=notes), record_dtype()) as writer:
        writer.append_events([FAULT])
        writer.append(records(0, 1000))
        writer.append_events([STATE])
        writer.append_model(*ADOPTED)
        writer.append(records(1000, 2000))
    return path


def test_events_come_back(file: Path) -> None:
    """Each event has all its fields, whatever part of the recording is read."""
    assert read_telemetry(file).events == (FAULT, STATE)
    assert read_telemetry(file, 1.5).events == (FAULT, STATE)


def test_adopted_model_comes_back(file: Path) -> None:
    """A part of a recording has the model that was in use at its begin."""
    assert read_telemetry(file).adopted == (ADOPTED,)
    assert read_telemetry(file).model_text("x") == "# the first\n"
    assert read_telemetry(file, 1.0).model_text("x") == "# a model, µm\n"
    assert read_telemetry(file).model_text("y") is None


def test_events_explain_themselves(file: Path) -> None:
    """With h5py alone the columns of an event are texts and numbers with their meaning."""
    with h5py.File(file) as root:
        log = root["recording/event_log"]

        assert log["text"].asstr()[:].tolist() == ["3 µm", "RUN to HOLD"]
        assert log["t_s"][:].tolist() == [0.5, 0.7]
        assert h5py.check_enum_dtype(log["severity"].dtype) == {"info": 0, "warning": 1, "error": 2}
        assert all(each.attrs["description"] for each in log.values())


def test_events_are_written_with_the_records(tmp_path: Path) -> None:
    """A file that is being written shows the events up to its last portion."""
    path = tmp_path / "rec.h5"
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        writer.append_events([FAULT])
        writer.append(records(0, 1000))
        writer.append_events([STATE])
        meanwhile = read_telemetry(path).events

    assert meanwhile == (FAULT,)
    assert read_telemetry(path).events == (FAULT, STATE)


def test_long_texts_are_cut_off(tmp_path: Path) -> None:
    """A text that is longer than its column ends between two characters."""
    path = tmp_path / "rec.h5"
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        writer.append_events([STATE._replace(text="µ" * 1000, kind="a" * 99)])
    (event,) = read_telemetry(path).events

    assert (event.text, event.kind) == ("µ" * 256, "a" * 32)


def test_largest_model_fits() -> None:
    """The text of a model with as many operators as a file may have is not cut off."""
    path = shipped_config().axes["x"].model
    assert path is not None
    sides = ("right_stop_thresholds", "right_stop_weights", "left_stop_thresholds")
    longest = (-1.2345678901234567e-05,) * 1000
    model = load_model(path).model_copy(
        update=dict.fromkeys((*sides, "left_stop_weights"), longest)
    )

    assert 90_000 < len(dump_model(model).encode()) < MODEL_BYTES


def test_file_of_an_older_version(file: Path) -> None:
    """A recording without events has none; a flight record has them as lines of JSON."""
    with h5py.File(file, "r+") as root:
        del root["recording/event_log"], root["recording/adopted_models"]
    old = read_telemetry(file)
    with h5py.File(file, "r+") as root:
        root["recording/events/data"] = json.dumps(FAULT._replace(limit=nan)._asdict()) + "\n"
    (event,) = read_telemetry(file).events

    assert (old.events, old.adopted) == ((), ())
    assert event[:-1] == FAULT[:-1]
