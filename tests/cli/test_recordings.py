"""`piezod plot` and `piezod export`: recordings for people and other programs."""

import csv
import json
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from pyarrow import DictionaryType, parquet

from piezod.config.model_file import dump_model, load_model
from piezod.config.modes import Mode
from piezod.records.figures.telemetry import telemetry_figure
from piezod.records.recording import reader
from piezod.records.recording.export import table_of
from piezod.records.recording.marks import fault_spans, irregularities, states
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from tests.cli.conftest import Command
from tests.control.rig_stage import shipped_config
from tests.recorded import RATE_HZ, new_stage, run_modes, write_recording
from tests.records.telemetry import header, record_dtype, records


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a stage in two modes, with a skipped period in each."""
    path = tmp_path_factory.mktemp("recorded") / "rec.h5"
    stage = new_stage()
    run_modes(stage, (Mode.UNCOMPENSATED, Mode.FEEDFORWARD))
    write_recording(path, stage)
    return path


@pytest.fixture
def telemetry(recording: Path) -> RecordedTelemetry:
    """Return its contents."""
    return read_telemetry(recording)


def test_states_follow_each_other_without_a_gap(telemetry: RecordedTelemetry) -> None:
    """The spans cover the recording; in RUN they have the name of the mode."""
    spans = states(telemetry, "x")

    names = [span.name for span in spans if span.name not in ("SAFE", "READY")]
    assert names == ["uncompensated", "feedforward", "RAMP"]
    assert [a.end_s for a in spans[:-1]] == [b.begin_s for b in spans[1:]]
    assert (spans[0].begin_s, spans[-1].end_s) == (0.0, telemetry.cycles["t_s"][-1])


def test_missing_data_are_found(telemetry: RecordedTelemetry) -> None:
    """Skipped periods, lost records, invalid samples and late cycles are counted at their place."""
    t_s = telemetry.cycles["t_s"]
    telemetry.cycles["seq"][100:] += 3
    telemetry.axes["x"]["position_um"][200:202] = np.nan
    telemetry.cycles["late_ns"][300] = round(0.6e9 / RATE_HZ)
    found = {each.name: each for each in irregularities(telemetry, "x")}

    assert found["periods skipped by the loop"].cases == 2
    assert found["records lost"].cases == 3
    assert found["invalid samples"].cases == 2
    assert found["late cycles"].cases == 1
    assert found["records lost"].t_s.tolist() == [t_s[100]]
    assert found["invalid samples"].t_s.tolist() == t_s[200:202].tolist()
    assert found["late cycles"].t_s.tolist() == [t_s[300]]


def test_faults_have_their_names(telemetry: RecordedTelemetry) -> None:
    """The bits of both masks become the ids of the faults, and the time in which they were."""
    telemetry.cycles["present_lo"][:] = 0
    telemetry.cycles["present_lo"][10:20] = 0b101
    telemetry.cycles["present_hi"][15:30] = 1
    spans = fault_spans(telemetry)
    table = table_of(telemetry, ("x",))

    high = telemetry.header.bits["present_hi"][0]
    assert list(spans) == ["S1", "S3", high]
    assert [len(each) for each in spans.values()] == [2, 2, 2]
    assert spans["S1"][0].begin_s == telemetry.cycles["t_s"][10]
    assert table["faults_present"][[9, 10, 15, 25]].tolist() == ["", "S1 S3", f"S1 S3 {high}", high]


def test_figure_shows_missing_data(telemetry: RecordedTelemetry) -> None:
    """Each kind has a labelled row of marks at its instants, and each fault a row of bars."""
    telemetry.cycles["present_lo"][:] = 0
    telemetry.cycles["present_lo"][10:20] = 1
    figure = telemetry_figure(telemetry, "x")
    (panel,) = [each for each in figure.axes if each.get_title(loc="left").startswith("(d)")]

    labels = [each.get_text() for each in panel.get_yticklabels()]
    assert labels == ["2 periods skipped by the loop", "fault S1"]
    marked_s = np.asarray(panel.lines[0].get_xdata(), dtype=float)
    skipped = np.flatnonzero(np.diff(telemetry.cycles["skipped"])) + 1
    assert marked_s.tolist() == telemetry.cycles["t_s"][skipped].tolist()


def test_stage_below_its_command_has_a_positive_error(telemetry: RecordedTelemetry) -> None:
    """The figure has the sign that the status has."""
    columns = telemetry.axes["x"]
    columns["position_um"][:] = columns["command_um"] - 1.0
    figure = telemetry_figure(telemetry, "x")
    (panel,) = [each for each in figure.axes if each.get_title(loc="left").startswith("(b)")]

    drawn_um = np.asarray(panel.lines[0].get_ydata(), dtype=float)
    assert np.nanmin(drawn_um) == pytest.approx(1.0) == np.nanmax(drawn_um)


@pytest.mark.parametrize(
    ("ending", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
@pytest.mark.few(1)
def test_formats_of_a_figure(piezod: Command, recording: Path, ending: str, begins: bytes) -> None:
    """The ending of --out decides the format."""
    code, out, err = piezod("plot", recording, "--out", f"fig.{ending}", "--begin-s", 1)

    assert (code, out, err) == (0, f"Figure: fig.{ending}\n", "")
    assert Path(f"fig.{ending}").read_bytes().startswith(begins)


def test_table_has_names_and_units(piezod: Command, recording: Path) -> None:
    """CSV has one row per cycle; numbers come back to the last bit, states as their names."""
    document = json.loads(piezod("export", recording, "--json").out)
    with Path("rec.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))

    with h5py.File(recording) as file:
        position_um = file["recording/axis_x/position_um"][:]
    assert (document["file"], document["rows"]) == ("rec.csv", len(rows))
    assert [float(row["position_um"]) for row in rows] == position_um.tolist()
    assert {row["state"] for row in rows} >= {"SAFE", "READY", "RUN"}
    assert {row["mode"] for row in rows} == {"uncompensated", "feedforward"}
    assert {row["on_target"] for row in rows} <= {"0", "1"}
    assert list(rows[0]) == document["columns"]
    assert "present_lo" not in rows[0]


def test_parquet_has_units(piezod: Command, recording: Path) -> None:
    """Parquet has the columns of CSV, with units and descriptions; texts are categories."""
    csv_columns = json.loads(piezod("export", recording, "--json").out)["columns"]
    code, out, _ = piezod("export", recording, "--out", "rec.parquet")
    table = parquet.read_table("rec.parquet")
    drive_v = table.schema.field("drive_v").metadata

    assert (code, out.partition(",")[0]) == (0, f"rec.parquet: {table.num_rows} rows")
    assert table.schema.names == csv_columns
    with h5py.File(recording) as file:
        assert table["drive_v"].to_pylist() == file["recording/axis_x/drive_v"][:].tolist()
        assert (
            drive_v[b"description"].decode()
            == (file["recording/axis_x/drive_v"].attrs["description"])
        )
    assert drive_v[b"units"] == b"V"
    assert set(table["mode"].to_pylist()) == {"uncompensated", "feedforward"}
    assert isinstance(table.schema.field("mode").type, DictionaryType)
    assert json.loads(table.schema.metadata[b"piezod.configuration"])["axes"].keys() == {"x"}


def test_parquet_without_its_library(
    piezod: Command, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without pyarrow the command says how to install it, and writes nothing."""
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    code, _, err = piezod("export", recording, "--out", "rec.parquet")

    assert code == 1
    assert "pip install 'piezod[parquet]'" in err
    assert not Path("rec.parquet").exists()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_long_table_is_written_in_portions(
    piezod: Command, recording: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    """The table does not depend on the size of the portions, and a part may be written."""
    piezod("export", recording, "--out", f"whole.{ending}")
    monkeypatch.setattr(reader, "_PORTION", 300)
    piezod("export", recording, "--out", f"portions.{ending}")
    part = json.loads(piezod("export", recording, "--begin-s", 1, "--end-s", 2, "--json").out)

    if ending == "csv":
        assert Path("whole.csv").read_bytes() == Path("portions.csv").read_bytes()
    else:
        whole, portions = map(parquet.read_table, ("whole.parquet", "portions.parquet"))
        for name in whole.schema.names:
            np.testing.assert_array_equal(whole[name].to_pylist(), portions[name].to_pylist())
    rows = Path("rec.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert len(rows) == part["rows"] == 499


def test_table_of_several_axes_names_them(tmp_path: Path) -> None:
    """With several axes the columns of an axis begin with its name; with one they do not."""
    file = tmp_path / "two.h5"
    with TelemetryWriter(file, header(("x", "y")), record_dtype(2)) as writer:
        writer.append(records(0, 3, 2))
    telemetry = read_telemetry(file)

    assert {"x_drive_v", "y_drive_v", "t_s"} <= set(table_of(telemetry, ("x", "y")))
    assert "drive_v" in table_of(telemetry, ("y",))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("plot", "rec.h5", "--axis", "y"), "no axis y; its axes are x"),
        (("plot", "rec.h5", "--begin-s", 99), "no cycle is recorded in this part"),
        (("plot", "text.h5"), "text.h5: this is not an HDF5 file"),
        (("export", "rec.h5", "--out", "a.xls"), "must end in .csv or .parquet (got a.xls)"),
        (("plot", "rec.h5", "--out", "a.jpg"), "must end in .png or .svg or .pdf"),
    ],
)
def test_mistakes(
    piezod: Command, recording: Path, arguments: tuple[object, ...], message: str
) -> None:
    """A mistake is reported with the allowed values, and nothing is written."""
    Path("rec.h5").symlink_to(recording)
    Path("text.h5").write_text("t_s,drive_v\n", encoding="utf-8")
    code, _, err = piezod(*arguments)

    assert code != 0
    assert message in " ".join(err.split())
    assert sorted(path.name for path in Path().iterdir()) == ["rec.h5", "text.h5"]


def test_replay_repeats_and_compares(
    piezod: Command, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same model repeats the drive; another mode gives estimates and, if asked, a figure."""
    with monkeypatch.context() as undrawn:
        undrawn.setitem(sys.modules, "piezod.records.figures.style", None)
        same = piezod("replay", recording)
    other = piezod("replay", recording, "--mode", "trimmed", "--out", "fig.png")
    document = json.loads(piezod("replay", recording, "--mode", "trimmed", "--json").out)

    assert (same.code, same.err) == (other.code, other.err) == (0, "")
    assert "The replay repeats the recording: the drives differ by at most" in same.out
    assert "The errors of the replay, in mode trimmed, are estimates." in other.out
    assert Path("fig.png").read_bytes().startswith(b"\x89PNG")
    assert document["repeats"] is False
    assert document["verdict"] in " ".join(other.out.split())
    assert document["stand_in_rms_um"] < 0.1
    assert [row["replayed"] for row in document["modes"]] == ["trimmed", "trimmed"]
    assert document["modes"][0]["rms_um"] < 0.1 < document["modes"][0]["recorded_rms_um"]


def test_replay_uses_the_model_that_was_adopted(piezod: Command, recording: Path) -> None:
    """The model in use at the begin of the part decides, not that at the start of the file."""
    model = shipped_config().axes["x"].model
    assert model is not None
    first = load_model(model)
    weights = tuple(2 * weight for weight in first.right_stop_weights)
    other = first.model_copy(update={"right_stop_weights": weights})
    Path("rec.h5").write_bytes(recording.read_bytes())
    with h5py.File("rec.h5", "r+") as file:
        adopted = file["recording/adopted_models"]
        row = {"t_ns": file["recording/cycles/t_ns"][0], "axis": "x", "text": dump_model(other)}
        for name, value in {**row, "t_s": 0.0}.items():
            adopted[name].resize(1, axis=0)
            adopted[name][0] = value

    assert json.loads(piezod("replay", recording, "--json").out)["repeats"]
    assert not json.loads(piezod("replay", "rec.h5", "--json").out)["repeats"]


def test_replay_needs_a_model(piezod: Command, recording: Path) -> None:
    """A recording of a stage without a model, or of an older version, needs --model."""
    Path("old.h5").write_bytes(recording.read_bytes())
    with h5py.File("old.h5", "r+") as file:
        del file["recording/model_x"]
    model = shipped_config().axes["x"].model
    refused = piezod("replay", "old.h5")
    given = piezod("replay", "old.h5", "--model", model)

    assert (refused.code, given.code) == (1, 0)
    assert "the model of axis x is not in it; give one: --model" in refused.err
    assert "repeats the recording" in given.out
