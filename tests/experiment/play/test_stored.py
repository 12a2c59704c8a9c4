"""Learned tables as files: the same conditions find them, other ones are named."""

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from piezod.config.table_file import dump_table, load_table
from piezod.devices.interface import Identity
from piezod.errors import ConfigError
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.learn import STORED, learn
from piezod.experiment.play.stored import (
    Conditions,
    find_table,
    model_sha256,
    to_table_file,
    write_table,
)
from piezod.experiment.play.task import PlaySettings
from tests.experiment.play.rig_axis import SENSOR_DELAY_S, RigAxis, model, sine, task

RIG = Identity("piezod", "simulated stack", "seed 1", "0.1")
NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
CONDITIONS = Conditions("x", RIG, model_sha256(model()), SENSOR_DELAY_S, 0.0)
COMMAND = sine()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the learned table of a sine."""
    path = tmp_path_factory.mktemp("tables")
    play = learn(RigAxis(), task(COMMAND, PlaySettings(6, 0.3, 0.2)), lambda _: None)
    write_table(path / "table_x_01.yaml", to_table_file(play, CONDITIONS, NOW))
    return path


def test_file_round_trips(folder: Path) -> None:
    """Reading gives the same numbers, to the last bit."""
    table = load_table(folder / "table_x_01.yaml")
    (folder / "copy.yaml").write_text(dump_table(table), encoding="utf-8")

    assert load_table(folder / "copy.yaml") == table
    assert table.command_um == tuple(COMMAND.values_um.tolist())
    assert table.error_rms_pct < 0.2


def test_same_conditions_begin_where_learning_ended(folder: Path) -> None:
    """The first play with a stored table has the learned shape.

    Its mean differs by creep and drift: the rig of the earlier run had moved for seven plays.
    """
    found = find_table(folder, CONDITIONS, COMMAND)
    assert found.note == "begins with table_x_01.yaml, learned on 2026-03-01"
    assert found.wanted_um is not None
    settings = PlaySettings(2, 0.3, 0.2)
    again = learn(RigAxis(), task(COMMAND, settings, first_um=found.wanted_um), lambda _: None)

    assert again.reports[0].label == STORED
    first = again.reports[0]
    assert np.std(first.error_um) < 0.002 * COMMAND.swing_um
    assert first.measured.mean_pct < 1.5
    assert again.best.measured.max_pct < 0.5


@pytest.mark.parametrize(
    ("conditions", "command", "text"),
    [
        (CONDITIONS._replace(axis="y"), COMMAND, "axis x, now y"),
        (
            CONDITIONS._replace(device=RIG._replace(serial="seed 2")),
            COMMAND,
            "device piezod simulated stack seed 1, now piezod simulated stack seed 2",
        ),
        (CONDITIONS._replace(model_sha256="0" * 64), COMMAND, "model .{8}…, now 00000000…"),
        (
            CONDITIONS._replace(sensor_delay_s=1e-4),
            COMMAND,
            "sensor_delay_s 0.000171 s, now 0.0001",
        ),
        (CONDITIONS._replace(rest_v=5.0), COMMAND, "rest_v 0 V, now 5 V"),
        (CONDITIONS, COMMAND._replace(interval_ns=100_000), "interval 50000 ns, now 100000 ns"),
        (
            CONDITIONS,
            COMMAND._replace(values_um=COMMAND.values_um + 1.0),
            "offset 14 µm, now 15 µm",
        ),
        (
            CONDITIONS,
            sine(200.0, 4.0, 25.0)._replace(name=COMMAND.name),
            "another waveform",
        ),
        (
            CONDITIONS,
            sine(100.0)._replace(name=COMMAND.name),
            "100 points per period, now 200",
        ),
    ],
)
def test_changed_condition_is_named(
    folder: Path, conditions: Conditions, command: PeriodicCommand, text: str
) -> None:
    """A table is not used if one condition differs; the note says which one, and how."""
    found = find_table(folder, conditions, command)

    assert found.wanted_um is None
    assert "table_x_01.yaml is not used, changed since" in found.note
    assert re.search(text, found.note)


def test_newest_agreeing_table_is_used(folder: Path, tmp_path: Path) -> None:
    """Of several tables for the same conditions the last learned one counts."""
    table = load_table(folder / "table_x_01.yaml")
    write_table(tmp_path / "table_x_01.yaml", table)
    later = table.model_copy(update={"created_at": "2026-04-01T00:00:00+00:00"})
    write_table(tmp_path / "table_x_02.yaml", later)

    assert (
        "table_x_02.yaml, learned on 2026-04-01" in find_table(tmp_path, CONDITIONS, COMMAND).note
    )


def test_folder_without_tables_and_other_waveforms(folder: Path, tmp_path: Path) -> None:
    """A waveform that was never learned begins without a table, and the note says so."""
    for where, command in ((tmp_path, COMMAND), (folder, sine(50.0))):
        found = find_table(where, CONDITIONS, command)
        assert found.wanted_um is None
        assert "no table of this waveform" in found.note


def test_broken_file_is_reported_with_its_place(folder: Path, tmp_path: Path) -> None:
    """Lists of different length, and other kinds of files, are refused."""
    text = (folder / "table_x_01.yaml").read_text(encoding="utf-8")
    short = tmp_path / "table_short.yaml"
    head, _, tail = text.partition("drive_v: [")
    short.write_text(f"{head}drive_v: [1.0]\n", encoding="utf-8")
    assert tail
    with pytest.raises(ConfigError, match="one entry for each of 100 points"):
        load_table(short)
    other = tmp_path / "table_other.yaml"
    other.write_text("format: piezod-model\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="not a table file"):
        load_table(other)


def test_hash_depends_on_every_number_of_the_model() -> None:
    """Another weight, range or creep is another model."""
    known = model()
    weights = known.weights.copy()
    weights[3] = np.nextafter(weights[3], 1.0)

    assert model_sha256(known) == model_sha256(model())
    assert model_sha256(known) != model_sha256(replace(known, weights=weights))
