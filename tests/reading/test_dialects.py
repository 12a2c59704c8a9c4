"""Text files of programs and countries."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from piezod.errors import DataError
from piezod.reading.choices import Choices, parsed_choices
from piezod.reading.record import read_record
from tests.reading.lab import (
    COLUMNS,
    DRIVE_V,
    NAMES,
    POSITION_UM,
    SIZE,
    T_S,
    is_the_record,
    record_text,
    rows,
    write,
)

PREAMBLES = (
    "",
    "# stage 7, R. Müller\n",
    "Model,MSO44\nFirmware Version,1.44.3\n\nRecord Length,400,\n,,\nLabel,,\n",
    "Messung vom 27.11.2026\nPrüfling: P-885; Nr. 7\n\n",
    "Sample Interval\t0.001\nOperator\tlab\n***End_of_Header***\t\n",
)
HEADERS = (
    NAMES,
    ("Time [s]", "Drive (V)", "Displacement / µm"),
    ("T_S", " drive_v", "POSITION_UM "),
)
UNIT_ROWS = ("", "s,V,um", "(s),(V),(µm)")


@given(
    sep=st.sampled_from([",", ";", "\t", "|", " ", "  "]),
    decimal=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]),
    preamble=st.sampled_from(PREAMBLES),
    header=st.sampled_from(HEADERS),
    units=st.sampled_from(UNIT_ROWS),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    quoted=st.booleans(),
    trailing=st.booleans(),
    order=st.permutations(range(3)),
)
@example(  # names with spaces do not make spaces the separator
    sep="\t",
    decimal=",",
    encoding="utf-8",
    preamble="",
    header=HEADERS[1],
    units="",
    end="\n",
    quoted=False,
    trailing=False,
    order=[0, 1, 2],
)
def test_any_dialect_gives_the_same_record(
    tmp_path_factory: pytest.TempPathFactory,
    sep: str,
    decimal: str,
    encoding: str,
    preamble: str,
    header: tuple[str, ...],
    units: str,
    end: str,
    quoted: bool,
    trailing: bool,
    order: list[int],
) -> None:
    """Separator, decimal sign, encoding, lines above, units, ends and order do not matter."""
    spaces = sep.isspace() and sep != "\t"
    if spaces:
        header = NAMES  # names with spaces cannot be told apart then
    quoted = quoted or (sep == "," and decimal == ",")
    mark = '"' if quoted and not spaces else ""
    tail = sep if trailing and not spaces else ""
    if spaces and decimal == "," and "stage" in preamble:
        decimal = "."

    def line(cells: list[str]) -> str:
        return sep.join(f"{mark}{cells[k]}{mark}" for k in order) + tail

    lines = [line(list(header))]
    if units:
        lines.append(line(units.split(",")))
    for row in zip(*COLUMNS.values(), strict=True):
        lines.append(line([repr(float(value)).replace(".", decimal) for value in row]))
    text = preamble.replace("\n", end) + end.join(lines) + end
    path = write(tmp_path_factory.mktemp("dialect") / "a.csv", text, encoding)

    assert is_the_record(read_record(path).columns)


def test_scope_of_tektronix(tmp_path: Path) -> None:
    """Units stand in lines of their own above the names; two voltages must be told apart."""
    preamble = (
        "Model,MSO44\nFirmware Version,1.44.3\n\nPoint Format,Y,\nHorizontal Units,S,\n"
        "Horizontal Scale,1,\n,,\nSample Interval,0.001,\nRecord Length,400,\n\n"
        "Vertical Units,V,V\nVertical Offset,0,0\n,,\nLabel,,\nTIME,CH1,CH2\n"
    )
    text = preamble + rows(T_S - 5.0, DRIVE_V / 20.0, POSITION_UM / 2.0)
    path = write(tmp_path / "tek.csv", text)
    record = read_record(
        path, parsed_choices("t=TIME,drive=CH1,position=CH2", "drive=20,position=2")
    )

    assert record.columns["drive_v"] == pytest.approx(DRIVE_V, abs=1e-12)
    assert record.columns["position_um"] == pytest.approx(POSITION_UM, abs=1e-12)
    assert record.columns["t_s"] == pytest.approx(T_S - 5.0)
    assert any("20 · 'CH1'" in each for each in record.understood)
    with pytest.raises(DataError, match="t=TIME,drive=CH1,position=CH2 --scale position=UM_PER_V"):
        read_record(path)


def test_scope_of_keysight(tmp_path: Path) -> None:
    """Channels have numbers as names; they are names, not places."""
    text = "x-axis,1,2\nsecond,Volt,Volt\n" + rows(T_S, DRIVE_V, POSITION_UM)
    path = write(tmp_path / "keysight.csv", text)
    columns = read_record(path, parsed_choices("drive=1,position=2", "position=1")).columns

    assert is_the_record(columns)


def test_scope_of_rigol(tmp_path: Path) -> None:
    """The first column counts samples; start and interval stand beside the units."""
    text = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-5.0e+00,1.0e-03\n"
    lines = rows(np.arange(SIZE, dtype=np.float64), DRIVE_V, POSITION_UM).replace("\n", ",,\n")
    path = write(tmp_path / "rigol.csv", text + lines)
    record = read_record(path, parsed_choices("drive=CH1,position=CH2", "position=1"))

    assert is_the_record(record.columns)
    assert record.columns["t_s"][0] == -5.0


@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_lvm_of_labview(tmp_path: Path, x_columns: str) -> None:
    """The names have one column more than the rows; the time is a column or an interval."""
    head = (
        f"LabVIEW Measurement\t\nX_Columns\t{x_columns}\nSeparator\tTab\n"
        "Decimal_Separator\t,\nDate\t2026/11/27\n"
        "***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t400\t400\t\nY_Unit_Label\tV\tum\t\n"
        "X_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\nDelta_X\t0,001\t0,001\t\n"
        "***End_of_Header***\t\t\t\nX_Value\tDrive\tPosition\tComment\n"
    )
    columns = [T_S, DRIVE_V, POSITION_UM]
    if x_columns == "No":
        columns, head = columns[1:], head.replace("X_Value\t", "")
    path = write(tmp_path / "a.lvm", head + rows(*columns, sep="\t", decimal=","))

    assert is_the_record(read_record(path, parsed_choices("drive=Drive,position=Position")).columns)


def test_numbers_without_names_have_places(tmp_path: Path) -> None:
    """Without names nothing can be told, and the error has the command with places."""
    path = write(tmp_path / "a.csv", rows(*COLUMNS.values()))

    with pytest.raises(DataError, match="--columns t=1,drive=2,position=3"):
        read_record(path)
    assert is_the_record(read_record(path, parsed_choices("t=1,drive=2,position=3")).columns)


def test_grouped_thousands_are_said(tmp_path: Path) -> None:
    """Numbers such as "1,234.5" are read, and the report says that they are grouped."""
    nm = [f'"{1000.0 * each:,.1f}"' for each in POSITION_UM]
    lines = (f"{t},{v},{x}" for t, v, x in zip(T_S.tolist(), DRIVE_V.tolist(), nm, strict=True))
    path = write(tmp_path / "a.csv", "t_s,drive_v,position_nm\n" + "\n".join(lines))
    record = read_record(path)

    assert record.columns["position_um"] == pytest.approx(POSITION_UM)
    assert "grouped" in record.understood[0]


def test_time_that_the_file_does_not_have_is_given(tmp_path: Path) -> None:
    """`--rate-hz` counts the samples; a time that the file has is then not used."""
    path = write(tmp_path / "a.csv", "drive_v,position_um\n" + rows(DRIVE_V, POSITION_UM))
    with_time = write(tmp_path / "b.csv", record_text())

    with pytest.raises(DataError, match="--rate-hz RATE"):
        read_record(path)
    assert is_the_record(read_record(path, Choices(rate_hz=1000.0)).columns)
    doubled = read_record(with_time, Choices(rate_hz=2000.0))
    assert doubled.columns["t_s"] == pytest.approx(T_S / 2.0)
    assert "2000 samples a second" in " ".join(doubled.understood)


def test_numbers_in_portions_are_those_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is parsed in portions, whose borders lie anywhere."""
    path = write(tmp_path / "a.csv", record_text())

    for size in (1, 7, 100, 1001):
        monkeypatch.setattr("piezod.reading.text._PORTION", size)
        assert is_the_record(read_record(path).columns)


@pytest.mark.parametrize("last", ["10,018;1,302", "10;1"])
def test_decimal_comma_is_told_by_all_rows(tmp_path: Path, last: str) -> None:
    """Cells such as 10,018 are no thousands, even if the last row has whole numbers."""
    lines = [f"{k};{10 + k % 50},018;{1 + k % 50 // 10},302" for k in range(200)]
    path = write(tmp_path / "a.csv", "\n".join(["t_ms;drive_v;position_um", *lines, f"200;{last}"]))

    record = read_record(path)

    assert record.columns["drive_v"][:2].tolist() == [10.018, 11.018]


def test_grouped_thousands_are_told_by_other_cells(tmp_path: Path) -> None:
    """A time of 0.001 has a decimal point, so that 60,000 beside it is no decimal comma."""
    lines = [f"{k / 1000:.3f};{60_000 + k:,};{4_000 + k:,}" for k in range(2200)]
    path = write(tmp_path / "a.csv", "\n".join(["t_s;drive_mV;position_nm", *lines]))

    record = read_record(path)

    assert record.columns["drive_v"][:2].tolist() == [60.0, 60.001]
    assert "thousands" in record.understood[0]
