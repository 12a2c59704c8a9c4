"""Files of other programs, written by the libraries that read them, or by others."""

import io
import sys
import zipfile
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest

from piezod.errors import DataError
from piezod.reading.choices import Choices, parsed_choices
from piezod.reading.record import read_record
from tests.reading.lab import (
    COLUMNS,
    DRIVE_V,
    POSITION_UM,
    T_S,
    is_the_record,
    record_text,
    write,
)
from tests.reading.writers import WRITERS, hdf5, xlsx


@pytest.mark.parametrize("name", WRITERS)
def test_each_format_gives_the_same_record(tmp_path: Path, name: str) -> None:
    """Names and units of the file are enough; what was understood is said."""
    WRITERS[name](tmp_path / name)
    record = read_record(tmp_path / name)

    assert is_the_record(record.columns)
    assert record.understood


@pytest.mark.parametrize("name", WRITERS)
def test_its_name_does_not_matter(tmp_path: Path, name: str) -> None:
    """The format is told by the contents; a spreadsheet may be called .csv."""
    WRITERS[name](tmp_path / name)
    other = (tmp_path / name).rename(tmp_path / "record.csv")

    assert is_the_record(read_record(other).columns)


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "a.npy"])
def test_half_a_file_is_refused(tmp_path: Path, name: str) -> None:
    """A copy that broke off gives an error with the name of the file."""
    path = tmp_path / name
    WRITERS[name](path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    with pytest.raises(DataError, match=str(path)):
        read_record(path)


@pytest.mark.parametrize("transposed", [False, True])
def test_array_without_names_has_places(tmp_path: Path, transposed: bool) -> None:
    """The longer dimension is that of the samples."""
    table = np.stack([*COLUMNS.values()], axis=0 if transposed else 1)
    np.save(tmp_path / "a.npy", table)
    np.savez(tmp_path / "b.npz", data=table)

    with pytest.raises(DataError, match="t=1,drive=2,position=3"):
        read_record(tmp_path / "a.npy")
    plain = read_record(tmp_path / "a.npy", parsed_choices("t=1,drive=2,position=3"))
    named = parsed_choices("t=data.1,drive=data.2,position=data.3")
    assert is_the_record(plain.columns)
    assert is_the_record(read_record(tmp_path / "b.npz", named).columns)


def test_part_of_a_file_is_named_behind_a_colon(tmp_path: Path) -> None:
    """A group or dataset of HDF5, a sheet and a group of channels are chosen so."""
    hdf5(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.copy("scan/axis", "scan/second")
        file["all"] = np.stack([*COLUMNS.values()], axis=1)

    with pytest.raises(DataError, match=r"axis/time.*second/time"):
        read_record(tmp_path / "a.h5")
    assert is_the_record(read_record(Path(f"{tmp_path}/a.h5:/scan/second")).columns)
    places = parsed_choices("t=all.1,drive=all.2,position=all.3")
    assert is_the_record(read_record(Path(f"{tmp_path}/a.h5:/all"), places).columns)
    with pytest.raises(DataError, match="there is no /none in it"):
        read_record(Path(f"{tmp_path}/a.h5:/none"))


def test_several_sheets_with_numbers_are_asked_about(tmp_path: Path) -> None:
    """None is taken silently."""
    xlsx(tmp_path / "a.xlsx")
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    book.copy_worksheet(book["Sheet"]).title = "Second"
    book.save(tmp_path / "a.xlsx")

    with pytest.raises(DataError, match=r"a\.xlsx:/Second"):
        read_record(tmp_path / "a.xlsx")
    assert is_the_record(read_record(Path(f"{tmp_path}/a.xlsx:/Second")).columns)


def test_bad_cell_of_a_sheet_is_named(tmp_path: Path) -> None:
    """The row is that of the spreadsheet."""
    xlsx(tmp_path / "a.xlsx")
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    book["Sheet"]["B50"] = "broken"
    book.save(tmp_path / "a.xlsx")

    with pytest.raises(DataError, match="row 50: Drive is 'broken'"):
        read_record(tmp_path / "a.xlsx")


def test_columns_of_different_length_are_refused(tmp_path: Path) -> None:
    """The error has the length of each."""
    np.savez(tmp_path / "a.npz", t_s=T_S, drive_v=DRIVE_V[:-1], position_um=POSITION_UM)

    with pytest.raises(DataError, match="t_s 400, drive_v 399, position_um 400"):
        read_record(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("name", "library"), [("a.xlsx", "openpyxl"), ("a.tdms", "nptdms"), ("a.parquet", "pyarrow")]
)
def test_missing_library_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, library: str
) -> None:
    """One line says what to install."""
    WRITERS[name](tmp_path / name)
    monkeypatch.setitem(sys.modules, library, None)

    with pytest.raises(DataError, match=rf"needs {library}.*pip install 'piezod\[import\]'"):
        read_record(tmp_path / name)


def _zip(name: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(name, "anything")
    return packed.getvalue()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "a PNG picture"),
        (b"%PDF-1.7\n" + bytes(100), "a PDF document"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(100), r"save it as \.xlsx or CSV"),
        (b"\x1f\x8b\x08" + bytes(100), "unpack it first"),
        (_zip("content.xml"), "an OpenDocument file"),
        (_zip("record.csv"), "a zip archive; unpack it first"),
        (bytes(range(256)) * 40, "neither text nor of a known format"),
        (b"title: my stage\nrate_hz: fast\n", "there are no rows of numbers"),
        (b"", "the file is empty"),
    ],
)
def test_file_of_another_kind_is_called_so(tmp_path: Path, content: bytes, what: str) -> None:
    """The error says what the file is."""
    (tmp_path / "a.csv").write_bytes(content)

    with pytest.raises(DataError, match=what):
        read_record(tmp_path / "a.csv")


def test_model_file_is_no_record(tmp_path: Path) -> None:
    """Lists of numbers in YAML are not taken for columns."""
    write(tmp_path / "m.yaml", "weights:\n  [1.0, 2.0,\n  3.0, 4.0]\n")

    with pytest.raises(DataError, match="a YAML file, as of a model"):
        read_record(tmp_path / "m.yaml")


def test_text_has_no_parts(tmp_path: Path) -> None:
    """A part of a text file is refused."""
    write(tmp_path / "a.csv", record_text())

    with pytest.raises(DataError, match="a text file has no parts"):
        read_record(Path(f"{tmp_path}/a.csv:/b"), Choices())


@pytest.mark.parametrize("text", ["10,018", "10,5", "1,234.5"])
def test_text_with_a_comma_in_a_sheet_is_refused(tmp_path: Path, text: str) -> None:
    """Nobody knows whether it is a decimal comma, so that the row is named."""
    book = openpyxl.Workbook()
    book.active.append(["t_s", "drive_v", "position_um"])
    for k in range(200):
        book.active.append([k / 1000.0, text, float(k)])
    book.save(tmp_path / "a.xlsx")

    with pytest.raises(DataError, match=r"row 2.*drive_v.*text"):
        read_record(tmp_path / "a.xlsx")


def test_row_beyond_every_sheet_is_refused(tmp_path: Path) -> None:
    """A file that names row two thousand million does not have that many empty rows."""
    xlsx(tmp_path / "good.xlsx")
    path = tmp_path / "a.xlsx"
    with zipfile.ZipFile(tmp_path / "good.xlsx") as good, zipfile.ZipFile(path, "w") as changed:
        for name in good.namelist():
            row = b'<row r="2000000000"><c r="A2000000000"><v>9</v></c></row></sheetData>'
            changed.writestr(name, good.read(name).replace(b"</sheetData>", row))

    with pytest.raises(DataError, match="rows"):
        read_record(path)


def test_archive_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    """Its directory says so, before anything is unpacked."""
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **COLUMNS)  # type: ignore[arg-type] # a flag, too
    content, size = path.read_bytes(), (COLUMNS["t_s"].nbytes + 128).to_bytes(4, "little")
    begin = content.index(b"PK\x01\x02")
    assert size in content[begin:]
    directory = content[begin:].replace(size, (2_000_000_000).to_bytes(4, "little"))
    path.write_bytes(content[:begin] + directory)

    with pytest.raises(DataError, match="unpacked"):
        read_record(path)
