"""`piezod record show`, and recordings of a running stage by their names."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.records.recording import reader
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.summary import summary_of
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import record_dtype
from piezod.telemetry.descriptions import mask_bits
from piezod.telemetry.layout import enumerations
from piezod.telemetry.record import StageEvent
from tests.cli.conftest import Command
from tests.client.fake_daemon import FakeDaemon, Raw

NAME = "20240501T120000Z-scan"
START_NS = 5_000_000_000
CYCLES = 3000
MODEL = "method: surface\nsource: {file: scan.csv}\ncreated_at: 2024-05-01T12:00:00+00:00\n"
CONFIGURATION = {"title": "Bench", "devices": {"rig": {"driver": "simulated"}}}
EVENT = StageEvent(START_NS + 1_200_000_000, "error", "fault", "no sample", "S5", "x", 3.0, 2.0)


def cycles() -> NDArray[Any]:
    """Return 3 s at 1 kHz: at rest, then in two modes, with something irregular of each kind."""
    made = np.zeros(CYCLES, record_dtype(1))
    number = np.arange(CYCLES)
    made["seq"], made["t_ns"] = number + 1, START_NS + number * 1_000_000
    made["state"] = np.where(number < 1000, list(State).index(State.SAFE), 0)
    made["state"][1000:] = list(State).index(State.RUN)
    made["late_ns"][[5, 1500]] = 600_000
    made["skipped"][2000:] = 3
    made["present_lo"][1200:1300] = 1 << list(Fault).index(Fault.S5)
    made["present_lo"][2500] = 1 << list(Fault).index(Fault.S5)
    axis = made["axes"][:, 0]
    axis["mode"] = np.where(number < 2000, *map(list(Mode).index, (Mode.FEEDFORWARD, Mode.TRIMMED)))
    axis["command_um"] = 1.0
    axis["position_um"] = np.where(number < 2000, 1.5, 1.1)
    axis["position_um"][1500] = 4.0
    axis["position_um"][1200:1210] = np.nan
    return made


@pytest.fixture
def recording(folder: Path) -> Path:
    """Return the recording of these cycles, relative to the folder of the command."""
    names = {name: [str(m.value) for m in members] for name, members in enumerations().items()}
    header = TelemetryHeader(
        title="scan",
        axes=("x",),
        rate_hz=1000.0,
        started_at="2024-05-01T12:00:00+00:00",
        start_ns=START_NS,
        names=names,
        notes={"configuration": json.dumps(CONFIGURATION), "model_x": MODEL},
        bits=mask_bits(),
    )
    with TelemetryWriter(folder / "rec.h5", header, record_dtype(1)) as writer:
        writer.append_events([EVENT._replace(text=f"no sample {at}") for at in range(30)])
        writer.append_model(START_NS + 900_000_000, "x", MODEL.replace("surface", "lms"))
        writer.append(cycles(), 7)
    return Path("rec.h5")


def test_document_has_what_is_in_it(piezod: Command, recording: Path) -> None:
    """The numbers are those of the cycles."""
    code, out, _ = piezod("record", "show", recording, "--json")
    shown = json.loads(out)

    assert code == 0
    assert (shown["begin_s"], shown["end_s"], shown["cycles"]) == (0.0, 2.999, 3000)
    assert (shown["late"], shown["skipped"], shown["lost"]) == (2, 3, 7)
    assert shown["invalid_samples"] == {"x": 10}
    assert shown["states_s"] == {"SAFE": 1.0, "RUN": 2.0}
    feedforward, trimmed = shown["errors"]
    assert (feedforward["mode"], feedforward["duration_s"]) == ("feedforward", 0.99)
    assert feedforward["rms_um"] == pytest.approx(((989 * 0.25 + 9.0) / 990) ** 0.5)
    assert feedforward["worst_um"] == 3.0
    assert (trimmed["mode"], trimmed["worst_um"]) == ("trimmed", pytest.approx(0.1))
    assert shown["faults"] == [{"fault": "S5", "cycles": 101, "first_s": 1.2, "last_s": 2.5}]
    assert shown["configuration"] == CONFIGURATION
    assert [(each["since_s"], each["text"][:11]) for each in shown["models"]] == [
        (None, "method: sur"),
        (0.9, "method: lms"),
    ]
    assert [each["text"] for each in shown["events"]] == [f"no sample {at}" for at in range(30)]


def test_text_has_the_same(piezod: Command, recording: Path) -> None:
    """People get a line for each, and the last events of the log."""
    code, out, _ = piezod("record", "show", recording, "--events", 2)

    assert code == 0
    for text in (
        "0.000 to 2.999 s: 2.999 s",
        "3000 at 1000 Hz; 2 late, 3 periods skipped, 7 cycles lost",
        "x, 10 samples invalid",
        "SAFE 1.0 s, RUN 2.0 s",
        "Bench; devices rig (simulated)",
        "surface of scan.csv, 2024-05-01",
        "lms of scan.csv, 2024-05-01T12:00:00+00:00, adopted at 0.900 s",
        "fault S5       101 cycles, 1.200 to 2.500 s",
        "the last 2 of 30 events\n       1.200 s  fault S5 x: no sample 28\n",
    ):
        assert text in out, text


def test_long_recording_is_read_in_portions(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result does not depend on the size of the portions."""
    whole = summary_of(recording)
    monkeypatch.setattr(reader, "_PORTION", 700)
    parts = summary_of(recording)

    assert parts.errors[0].rms_um == pytest.approx(whole.errors[0].rms_um)
    assert parts.models[1:] == whole.models[1:]
    for name in ("begin_s", "end_s", "late", "skipped", "invalid", "states", "faults"):
        assert getattr(parts, name) == getattr(whole, name), name


def test_recording_without_cycles(piezod: Command, recording: Path) -> None:
    """A recording that was ended at once says so."""
    header = reader.read_telemetry(recording).header
    TelemetryWriter(Path("empty.h5"), header, record_dtype(1)).close()
    code, out, _ = piezod("record", "show", "empty.h5")

    assert (code, out.splitlines()[-1]) == (0, "cycles         none")


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (("show",), ""),
        (("plot",), f"{NAME}.png"),
        (("export", "--axis", "x"), f"{NAME}.csv"),
    ],
)
def test_recording_of_a_stage_by_its_name(
    piezod: Command, daemon: FakeDaemon, recording: Path, arguments: tuple[str, ...], file: str
) -> None:
    """The name stands for the file of the running stage; the output is in the current folder."""
    daemon.answers[f"GET recordings/{NAME}"] = Raw(200, recording.read_bytes())
    daemon.answers["GET recordings"] = {"running": None, "recordings": [{"name": NAME}]}
    verb, *options = arguments
    by_name = piezod("record", verb, NAME, *options, "--json")
    document = json.loads(by_name.out)

    assert (by_name.code, by_name.err) == (0, "")
    assert document["recording"] == NAME
    assert not file or Path(file).stat().st_size > 1000
    assert not Path(f"{NAME}.h5").exists()


def test_further_files_are_told(piezod: Command, daemon: FakeDaemon, recording: Path) -> None:
    """Only one file is used: people learn that the recording goes on in others."""
    daemon.answers[f"GET recordings/{NAME}"] = Raw(200, recording.read_bytes())
    names = [f"{NAME}-0003", f"{NAME}-0002", NAME, f"{NAME}-b"]
    finished = [{"name": name} for name in names]
    daemon.answers["GET recordings"] = {"running": None, "recordings": finished}
    code, _, err = piezod("record", "show", NAME, "--json")

    assert code == 0
    assert err == (
        f"{NAME} is the first file of the recording; it goes on in {NAME}-0002 to {NAME}-0003\n"
    )


def test_name_that_the_stage_does_not_have(piezod: Command, daemon: FakeDaemon) -> None:
    """The answer of the daemon is passed on."""
    daemon.refuse(f"GET recordings/{NAME}", 404, "unknown", f"no recording '{NAME}'", "list")
    code, _, err = piezod("plot", NAME)

    assert code == 1
    assert f"no recording '{NAME}'" in err


def test_word_that_is_no_name_is_a_file(piezod: Command) -> None:
    """A missing file is reported as such, without a running stage."""
    code, _, err = piezod("record", "replay", "scan.h5")

    assert code == 2
    assert "no such file (got scan.h5)" in err
