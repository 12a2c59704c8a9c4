"""The recordings of a stage, as the supervisor starts them."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.config.model_file import load_model
from piezod.daemon.loop import accept
from piezod.records.telemetry_reader import read_telemetry
from piezod.telemetry.descriptions import descriptions, mask_bits
from tests.daemon.bench import PEER, Bench
from tests.daemon.daemons import REPOSITORY


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """Return a link without devices, for the shipped stage."""
    bench = Bench(tmp_path, accept.load(REPOSITORY / "config" / "simulated.yaml"))
    yield bench
    bench.link.stage_audit.close()


def test_a_recording_has_everything_to_understand_it(bench: Bench, tmp_path: Path) -> None:
    """The file has meanings, bits, the configuration, and the model in use as a model file."""

    async def record() -> str:
        name = str((await bench.link.start_recording(None, PEER))["name"])
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
