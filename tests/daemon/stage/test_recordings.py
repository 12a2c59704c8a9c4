"""The recordings of a stage, as the supervisor starts them."""

import asyncio
import json
import time
from itertools import chain, repeat
from pathlib import Path

import pytest

from piezod.config.daemon import RecordingsConfig
from piezod.config.model_file import dump_model, load_model
from piezod.config.states import State
from piezod.daemon.stage.errors import BadValueError, NotNowError, UnknownNameError
from piezod.messages.recording_edge import RecordingEdge
from piezod.records.recording.reader import read_telemetry
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.events import EventWriter
from piezod.telemetry.record import StageEvent
from tests.daemon.bench import PEER, Bench


def test_a_recording_has_everything_to_understand_it(bench: Bench, tmp_path: Path) -> None:
    """The file has meanings, bits, the configuration, and the model in use as a model file."""

    async def record() -> str:
        name = str((await bench.link.start_recording(None, PEER)).name)
        await bench.link.stop_recording(PEER)
        return name

    name = asyncio.run(record())
    header = read_telemetry(bench.link.recordings_folder / f"{name}.h5").header

    assert header.descriptions == descriptions()
    assert header.bits == mask_bits()
    assert "x" in json.loads(header.notes["configuration"])["axes"]
    copy = tmp_path / "copy.yaml"
    copy.write_text(header.notes["model_x"], encoding="utf-8")
    assert load_model(copy) == bench.loop.models["x"]


def test_events_and_adopted_models_are_recorded(bench: Bench) -> None:
    """The log of the loop is in the file, and a model that an axis adopts meanwhile."""
    model = bench.loop.models["x"]
    assert model is not None
    other = model.model_copy(update={"delay_s": 0.001})
    event = StageEvent(1, "info", "state", "SAFE to READY", "", "", 0.0, 0.0)

    async def record() -> str:
        name = str((await bench.link.start_recording(None, PEER)).name)
        EventWriter(bench.loop.shared).append(event)
        bench.loop.models["x"] = other
        bench.record(State.SAFE)
        await bench.link.stop_recording(PEER)
        return name

    name = asyncio.run(record())
    found = read_telemetry(bench.link.recordings_folder / f"{name}.h5")

    assert found.events == (event,)
    assert [(each.axis, each.text) for each in found.adopted] == [("x", dump_model(other))]
    assert found.header.notes["model_x"] == dump_model(model)


def test_recording_begins_at_its_instant(bench: Bench) -> None:
    """Time 0 of the file is the instant; one that the file could not keep is refused."""
    start_s = time.monotonic() + 20.0

    async def record() -> str:
        name = str((await bench.link.start_recording(None, PEER, start_s=start_s)).name)
        await bench.link.stop_recording(PEER)
        return name

    name = asyncio.run(record())
    header = read_telemetry(bench.link.recordings_folder / f"{name}.h5").header

    assert header.start_ns == round(start_s * 1e9)
    with pytest.raises(BadValueError, match="start_s has passed"):
        asyncio.run(bench.link.start_recording(None, PEER, start_s=start_s - 21.0))


def test_stage_without_the_line_refuses_to_wait_for_its_edge(bench: Bench) -> None:
    """The refusal names the lines of the stage, and what to do."""
    edge = RecordingEdge(line="exposed")
    with pytest.raises(BadValueError, match=r"no line 'exposed': the stage has none.*`lines:`"):
        asyncio.run(bench.link.start_recording(None, PEER, edge=edge))

    assert bench.link.stage_recordings.running_name == ""


def test_recording_that_was_ready_too_late_is_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file without its first cycles would look complete."""
    instants_ns = chain([0, 0], repeat(2 * 10**9))
    clock = "piezod.daemon.stage.recordings.time.monotonic_ns"
    monkeypatch.setattr(clock, lambda: next(instants_ns))

    with pytest.raises(NotNowError, match=r"the file was ready 1 s after start_s"):
        asyncio.run(bench.link.start_recording(None, PEER, start_s=1.0))

    assert bench.link.stage_recordings.running_name == ""


def test_configuration_limits_the_recordings(bench: Bench) -> None:
    """A kept recording stays, an older one is removed, and a running one names its file."""
    limits = RecordingsConfig(max_total_mb=1)
    bench.loop.config = bench.loop.config.model_copy(update={"recordings": limits})
    folder = bench.link.recordings_folder
    kept, old = "20240501T120000Z", "20240501T120001Z"
    for name, size in ((kept, 10), (old, 1_000_000)):
        (folder / f"{name}.h5").write_bytes(bytes(size))

    async def record() -> tuple[str, list[str]]:
        await bench.link.keep_recording(kept, PEER, kept=True)
        await bench.link.start_recording(None, PEER)
        found = await bench.link.recordings()
        await bench.link.stop_recording(PEER)
        assert found.running is not None
        return found.running.file, [each.name for each in found.recordings]

    running, finished = asyncio.run(record())

    assert finished == [kept]
    assert (folder / f"{running}.h5").exists()
    with pytest.raises(UnknownNameError, match="no recording 'x'"):
        asyncio.run(bench.link.keep_recording("x", PEER, kept=True))


def test_mark_on_a_disk_that_refuses_it(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The client gets the reason of the disk."""

    def fail(_path: Path) -> None:
        raise OSError(28, "No space left on device")

    (bench.link.recordings_folder / "20240501T120000Z.h5").touch()
    monkeypatch.setattr(Path, "touch", fail)

    with pytest.raises(NotNowError, match=r"the mark was not changed: .*No space left"):
        asyncio.run(bench.link.keep_recording("20240501T120000Z", PEER, kept=True))
