"""Which format a file has, by its first bytes, and the reader of each."""

import importlib
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from piezod.errors import DataError
from piezod.given_file import open_given
from piezod.reading.hdf5_magic import MOST_FILE_BYTES, is_hdf5
from piezod.reading.part import split_path
from piezod.reading.table import MOST_BYTES, Table

_OTHERS: Final = (
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"%PDF", "a PDF document"),
    (b"\x1f\x8b", "compressed by gzip; unpack it first"),
    (b"BZh", "compressed by bzip2; unpack it first"),
    (b"\xfd7zXZ", "compressed by xz; unpack it first"),
    (b"7z\xbc\xaf", "a 7z archive; unpack it first"),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word file; save it as .xlsx or CSV"),
    (b"SQLite format 3", "an SQLite database"),
    (b"\x80\x04\x95", "a pickle of Python; save the arrays with numpy.savez"),
    (b"\x7fELF", "a program"),
)
"""First bytes of files that are no tables, and what they are."""
_TEXTS: Final = {
    ".yaml": "a YAML file, as of a model or a stage",
    ".yml": "a YAML file, as of a model or a stage",
    ".json": "a JSON file",
    ".html": "a web page",
    ".xml": "an XML file",
    ".py": "a program",
    ".m": "a program",
    ".ipynb": "a notebook",
}
"""Endings of text files that are no tables, and what they are."""
_MOST_UNPACKED: Final = 4_000_000_000
"""Largest size of what is in an archive, in bytes."""
_ARCHIVES: Final = (
    ("xl/workbook.xml", "sheet:open_sheet"),
    ("content.xml", "an OpenDocument file; save it as .xlsx or CSV"),
    ("word/document.xml", "a Word document; save the table as CSV"),
)


def open_table(path: Path) -> Table:
    """Return the table in a file of any known format.

    Args:
        path: The file; a part may follow, as in `file.h5:/group` or `file.xlsx:/Sheet2`.

    Raises:
        DataError: If the file has no table that can be read.
        OSError: If the file cannot be read.
    """
    file, part = split_path(path)
    with open_given(file, MOST_FILE_BYTES) as opened:
        begin = opened.read(256)
        size = opened.seek(0, 2)
    if is_hdf5(file):
        return _reader("hdf5:open_hdf5")(file, part)
    if size > MOST_BYTES:
        what = f"the file is too large, allowed: at most {MOST_BYTES} bytes"
        raise DataError(f"{file}: {what}; give a shorter one, or write it as HDF5")
    for magic, what in _OTHERS:
        if begin.startswith(magic):
            raise DataError(f"{file}: this is no table of numbers but {what}")
    if known := _by_magic(file, begin):
        return _reader(known)(file, part)
    if part:
        raise DataError(f"{path}: a text file has no parts; leave out ':{part}'")
    if kind := _TEXTS.get(file.suffix.lower()):
        raise DataError(f"{file}: this is no table of numbers but {kind}; give a record")
    return _reader("text:open_text")(file)


def _by_magic(file: Path, begin: bytes) -> str | None:
    if begin.startswith(b"PK\x03\x04"):
        return _in_archive(file)
    if begin.startswith(b"\x93NUMPY"):
        return "arrays:open_npy"
    if begin.startswith(b"PAR1"):
        return "parquet:open_parquet"
    if begin.startswith(b"TDSm"):
        return "tdms:open_tdms"
    if begin.startswith(b"MATLAB 5.0 MAT-file") or file.suffix.lower() == ".mat":
        return "arrays:open_mat"
    return None


def _in_archive(file: Path) -> str:
    names: list[str] = []
    with suppress(zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
        names, unpacked = archive.namelist(), sum(each.file_size for each in archive.infolist())
        if unpacked > _MOST_UNPACKED:
            what = f"unpacked it has {unpacked} bytes, allowed: at most {_MOST_UNPACKED}"
            raise DataError(f"{file}: {what}; give a shorter one, or write it as HDF5")
    for name, reader in _ARCHIVES:
        if name in names:
            if " " in reader:
                raise DataError(f"{file}: this is no table of numbers but {reader}")
            return reader
    if names and all(name.endswith(".npy") for name in names):
        return "arrays:open_npz"
    raise DataError(f"{file}: this is no table of numbers but a zip archive; unpack it first")


def _reader(name: str) -> Callable[..., Table]:
    # By name: h5py and scipy take long to import, and most files are text.
    module, function = name.split(":")
    reader: Callable[..., Table] = getattr(
        importlib.import_module(f"piezod.reading.{module}"), function
    )
    return reader
