"""Which column is time, drive and position, and how it becomes s, V and µm."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.errors import DataError
from piezod.reading.choices import TRAJECTORY, parsed_choices
from piezod.reading.record import read_record
from piezod.reading.units import parts_of_name
from tests.reading.lab import (
    COLUMNS,
    DRIVE_V,
    POSITION_UM,
    T_S,
    is_the_record,
    record_text,
    rows,
    write,
)


@pytest.mark.parametrize(
    ("name", "stem", "unit", "factor"),
    [
        ("t_s", "t", "s", 1.0),
        ("t_ms", "t", "ms", 1e-3),
        ("Time [µs]", "time", "µs", 1e-6),
        ("Time (\N{GREEK SMALL LETTER MU}s)", "time", "\N{GREEK SMALL LETTER MU}s", 1e-6),
        ("Zeit / min", "zeit", "min", 60.0),
        ("Piezo Voltage (mV)", "piezo voltage", "mV", 1e-3),
        ("POSITION_NM", "position", "NM", 1e-3),
        ("position.mm", "position", "mm", 1e3),
        ("x-axis", "x axis", None, None),
        ("Temperature (C)", "temperature c", None, None),
        ("position", "position", None, None),
    ],
)
def test_units_in_names(name: str, stem: str, unit: str | None, factor: float | None) -> None:
    """They are read in brackets, behind a slash and at the end; other endings are names."""
    found, parsed = parts_of_name(name)

    assert found == stem
    assert (parsed.text if parsed else None) == unit
    assert (parsed.factor if parsed else None) == factor


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("t_ms,drive_mv,position_nm", (1e3, 1e3, 1e3)),
        ("time (µs),voltage (kV),displacement (mm)", (1e6, 1e-3, 1e-3)),
        ("Elapsed Time [s],U [V],Interferometer [m]", (1.0, 1.0, 1e-6)),
    ],
)
def test_units_are_used_and_said(tmp_path: Path, header: str, factors: tuple[float, ...]) -> None:
    """Each column comes in s, V and µm, and a line says from what."""
    values = (column * factor for column, factor in zip(COLUMNS.values(), factors, strict=True))
    record = read_record(write(tmp_path / "a.csv", f"{header}\n{rows(*values)}"))

    for name, column in COLUMNS.items():
        assert record.columns[name] == pytest.approx(column, rel=1e-12)
    assert len(record.understood) == 4


def test_milliseconds_become_the_nearest_seconds(tmp_path: Path) -> None:
    """5 ms is 0.005 s to the last bit, as a person would write it."""
    values = (np.arange(400.0), DRIVE_V, POSITION_UM)
    path = write(tmp_path / "a.csv", "t_ms,drive_v,position_um\n" + rows(*values))

    assert np.array_equal(read_record(path).columns["t_s"], T_S)


def test_scale_offset_and_sign(tmp_path: Path) -> None:
    """Value times scale, its sign turned, plus offset; each is said."""
    header = "TIME [s],monitor [V],sensor [V]"
    text = f"{header}\n{rows(T_S, DRIVE_V / 20.0, (30.0 - POSITION_UM) / 2.0)}"
    choices = parsed_choices(
        "drive=monitor [V],position=sensor [V]",
        "drive=20,position=2",
        "position=30",
        "position",
    )
    record = read_record(write(tmp_path / "a.csv", text), choices)

    assert record.columns["drive_v"] == pytest.approx(DRIVE_V)
    assert record.columns["position_um"] == pytest.approx(POSITION_UM)
    assert any("-2 · 'sensor [V]' +30" in each for each in record.understood)


def test_volts_are_no_position_without_a_scale(tmp_path: Path) -> None:
    """The error asks for µm per V, in a command."""
    text = "t_s,drive_v,sensor_v\n" + rows(*COLUMNS.values())
    path = write(tmp_path / "a.csv", text)

    with pytest.raises(DataError, match="position=sensor_v --scale position=UM_PER_V"):
        read_record(path, parsed_choices("position=sensor_v"))


def test_number_without_a_unit_is_said(tmp_path: Path) -> None:
    """A column that a person names needs no unit; the report says which one was taken."""
    path = write(tmp_path / "a.csv", "a,b,c\n" + rows(*COLUMNS.values()))
    record = read_record(path, parsed_choices("t=a,drive=b,position=c"))

    assert is_the_record(record.columns)
    assert record.understood[-1] == "position_um = 'c', which has no known unit: taken as µm."


@pytest.mark.parametrize(
    "header",
    [
        "a,b,c",
        "time,voltage,displacement",
        "Time (s),CH 1,CH 2",
        'x,"u, raw","y=1"',
        "t_s,t_s,voltage_v,position_um",
    ],
)
def test_refused_columns_come_with_a_command_that_works(tmp_path: Path, header: str) -> None:
    """The error lists what is in the file; its command, carried out, reads it."""
    values = [*COLUMNS.values()]
    if header.count(",") == 3 and header.startswith("t_s"):
        values.insert(0, T_S)
    path = write(tmp_path / "a file.csv", f"{header}\n{rows(*values)}")
    with pytest.raises(DataError) as caught:
        read_record(path)
    text = str(caught.value)
    words = shlex.split(text[text.index("piezod identify") :])

    assert words[:3] == ["piezod", "identify", str(path)]
    assert read_record(path, parsed_choices(words[4])).columns["t_s"].size == 400
    for name in re.findall(r"[a-z]{3,}", header):
        assert name in text


def test_a_column_is_one_thing(tmp_path: Path) -> None:
    """A column for two roles is refused."""
    path = write(tmp_path / "a.csv", "t [s],u [V],x [um]\n" + rows(*COLUMNS.values()))

    with pytest.raises(DataError, match="twice"):
        read_record(path, parsed_choices("t=1,drive=2,position=u [V]", "position=2"))


def test_time_has_a_scale_too(tmp_path: Path) -> None:
    """Seconds that are milliseconds are read with the option that the question names."""
    values = (1e3 * T_S, DRIVE_V, POSITION_UM)
    path = write(tmp_path / "a.csv", "t_s,drive_v,position_um\n" + rows(*values))

    assert read_record(path, parsed_choices(scale="t=0.001")).columns["t_s"] == pytest.approx(T_S)


def test_likely_columns_are_proposed_by_their_names(tmp_path: Path) -> None:
    """Names without units are no proof, but good for the example."""
    values = rows(POSITION_UM, T_S, DRIVE_V)
    path = write(tmp_path / "a.csv", f"displacement,time,voltage\n{values}")

    with pytest.raises(DataError, match="t=time,drive=voltage,position=displacement"):
        read_record(path)
    path = write(tmp_path / "b.csv", f"t_s,elapsed_s,position_um\n{values}")
    with pytest.raises(DataError, match="drive=NAME,position=position_um"):
        read_record(path, parsed_choices("t=t_s"))


def test_two_columns_of_time_are_asked_about(tmp_path: Path) -> None:
    """Neither is taken silently, whatever its name."""
    text = "t_s,drive_v,position_um,time_ms\n" + rows(*COLUMNS.values(), 7.0 * T_S)
    path = write(tmp_path / "a.csv", text)

    with pytest.raises(DataError, match="which column is the time\\? 't_s' and 'time_ms'"):
        read_record(path)
    assert is_the_record(read_record(path, parsed_choices("t=t_s")).columns)


def test_unit_that_contradicts_the_name_is_refused(tmp_path: Path) -> None:
    """A row of units may not say otherwise than the name."""
    path = write(tmp_path / "a.csv", "t_s,drive_v,position_um\nms,V,um\n" + rows(*COLUMNS.values()))

    with pytest.raises(DataError, match="'t_s' has s in its name and ms as its unit"):
        read_record(path)


def test_voltage_in_force_goes_before_that_of_the_next_cycle(tmp_path: Path) -> None:
    """A table that piezod exported has both."""
    text = "t_s,drive_v,in_force_v,position_um\n" + rows(T_S, DRIVE_V[::-1], DRIVE_V, POSITION_UM)
    record = read_record(write(tmp_path / "a.csv", text))

    assert is_the_record(record.columns)
    assert "in_force_v" in " ".join(record.understood)


@pytest.mark.parametrize("name", ["command_um", "position_um", "target [nm]", "Setpoint (µm)"])
def test_trajectory_needs_no_drive(tmp_path: Path, name: str) -> None:
    """Positions that a stage shall follow have time and command, or position."""
    factor = 1000.0 if "nm" in name else 1.0
    path = write(tmp_path / "a.csv", f"t_s,{name}\n" + rows(T_S, factor * POSITION_UM))

    columns = read_record(path, roles=TRAJECTORY).columns
    assert columns["command_um"] == pytest.approx(POSITION_UM)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"columns": "t"}, "--columns: write it as in t=TIME"),
        ({"columns": "time=a"}, "--columns: 'time' is none of t, drive, position"),
        ({"columns": "t=a,t=b"}, "--columns: t is given twice"),
        ({"scale": "drive=x"}, "--scale: drive must be a number other than 0"),
        ({"scale": "drive=0"}, "--scale: drive must be a number other than 0"),
        ({"offset": "t=2"}, "--offset: 't' is none of drive, position"),
        ({"offset": "position=nan"}, "--offset: position must be a number"),
        ({"invert": "all"}, "--invert: 'all' is none of drive, position"),
    ],
)
def test_options_that_cannot_be_understood(options: dict[str, Any], said: str) -> None:
    """Each error begins with the name of the option."""
    with pytest.raises(DataError, match=f"^{said}"):
        parsed_choices(**options)


def test_rate_must_be_above_zero() -> None:
    """Neither zero nor negative rates count samples."""
    with pytest.raises(DataError, match="--rate-hz"):
        parsed_choices(rate_hz=0.0)


@pytest.mark.parametrize("wanted", ["none", "7", "0"])
def test_column_that_is_not_there_is_refused(tmp_path: Path, wanted: str) -> None:
    """Names and places are looked up; the error lists the columns."""
    path = write(tmp_path / "a.csv", record_text())

    with pytest.raises(DataError, match=f"no column '{wanted}'; the file has 't_s'"):
        read_record(path, parsed_choices(f"t={wanted}"))


def test_time_has_a_scale(tmp_path: Path) -> None:
    """Milliseconds under the name of seconds are corrected as the error about them says."""
    text = record_text().splitlines()
    path = write(tmp_path / "a.csv", text[0] + "\n" + rows(1e3 * T_S, DRIVE_V, POSITION_UM))

    assert is_the_record(read_record(path, parsed_choices(scale="t=0.001")).columns)
    with pytest.raises(DataError, match="--rate-hz"):
        parsed_choices(scale="t=0.001", rate_hz=1000.0)


def test_scale_counts_after_the_unit(tmp_path: Path) -> None:
    """What the error asks for, µm per V, is what the option means for a column in mV."""
    path = write(
        tmp_path / "a.csv", "t_s,drive_v,sensor_mV\n" + rows(T_S, DRIVE_V, 500.0 * POSITION_UM)
    )
    columns = "t=t_s,drive=drive_v,position=sensor_mV"

    with pytest.raises(DataError, match="how many µm one V is"):
        read_record(path, parsed_choices(columns))
    found = read_record(path, parsed_choices(columns, "position=2")).columns["position_um"]
    assert np.allclose(found, POSITION_UM)
