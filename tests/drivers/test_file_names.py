"""Every file of a driver is named in the table of `drivers/README.md`."""

import re
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Final, NamedTuple

import pytest

ROOT: Final = Path(__file__).parents[2] / "drivers"
PACKAGE: Final = ROOT / "piezod_drivers"
WITHOUT_BUS: Final = {"simulated", "emulated"}
WITHOUT_EMULATOR: Final = WITHOUT_BUS | {"comedi", "iio"}
"""The kernel has devices for tests of its own."""
PARTS: Final = {"emulation", "profiles"}
"""Folders inside a driver's folder; the table names their files with the folder."""


class Row(NamedTuple):
    """A row of the table."""

    patterns: tuple[str, ...]
    where: frozenset[str]

    def allows(self, folder: Path, name: str) -> bool:
        """Return whether a folder may have a file."""
        if not any(fnmatch(name, pattern) for pattern in self.patterns):
            return False
        drives = (folder / "driver.py").exists()
        emulated = drives and folder.name not in WITHOUT_EMULATOR
        return (
            bool(self.where & {"every folder", "any folder", folder.name})
            or (bool(self.where & {"every driver", "any driver"}) and drives)
            or ("every bus driver" in self.where and drives and folder.name not in WITHOUT_BUS)
            or ("every emulated driver" in self.where and emulated)
        )

    def is_required(self, folder: Path) -> bool:
        """Return whether a folder must have one of the files."""
        drives = (folder / "driver.py").exists()
        emulated = drives and folder.name not in WITHOUT_EMULATOR
        return (
            "every folder" in self.where
            or ("every driver" in self.where and drives)
            or ("every bus driver" in self.where and drives and folder.name not in WITHOUT_BUS)
            or ("every emulated driver" in self.where and emulated)
            or folder.name in self.where
        )


def rows() -> Iterator[Row]:
    """Read the table."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.partition("## File names")[2].partition("\n## ")[0]
    for line in table.splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if cells and cells[0].startswith("`"):
            where = frozenset(part.strip(" `") for part in cells[1].split(","))
            yield Row(tuple(re.findall(r"`([^`]+)`", cells[0])), where)


ROWS: Final = list(rows())
FOLDERS: Final = sorted(
    folder
    for folder in (path.parent for path in PACKAGE.rglob("*.py"))
    if folder != PACKAGE and folder.name not in PARTS
)
FOLDERS[:] = list(dict.fromkeys(FOLDERS))


def files_of(folder: Path) -> list[str]:
    """Return the files of a folder, and those of its parts with the part's name before them."""
    names = [path.name for path in folder.glob("*.py")]
    for part in PARTS:
        names += [f"{part}/{path.name}" for path in (folder / part).glob("*.py")]
    return sorted(names)


def named_in_docstring(folder: Path) -> set[str]:
    """Return the files that the docstring of a folder names."""
    return set(re.findall(r"`([a-z0-9_]+\.py)`", (folder / "__init__.py").read_text()))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_table_allows_every_file(folder: Path) -> None:
    """A folder has no file that the table does not allow there."""
    names = files_of(folder)

    assert [n for n in names if not any(row.allows(folder, n) for row in ROWS)] == []


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_required_files_exist(folder: Path) -> None:
    """A folder has the files that the table requires there."""
    names = files_of(folder)
    required = [row for row in ROWS if row.is_required(folder)]

    assert [
        row.patterns
        for row in required
        if not any(fnmatch(name, pattern) for name in names for pattern in row.patterns)
    ] == []


def test_every_row_names_a_file() -> None:
    """Every row, pattern and folder of the table has a file."""
    found = [(folder, name) for folder in FOLDERS for name in files_of(folder)]
    words = {f"{which} {what}" for which in ("every", "any") for what in ("folder", "driver")}
    words |= {"every bus driver", "every emulated driver"}

    assert [
        pattern
        for row in ROWS
        for pattern in row.patterns
        if not any(fnmatch(name, pattern) and row.allows(folder, name) for folder, name in found)
    ] == []
    assert {name for row in ROWS for name in row.where - words} <= {f.name for f in FOLDERS}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_docstring_of_a_folder_names_its_own_files(folder: Path) -> None:
    """The docstring of a folder names the files that only few folders have, and no missing one."""
    special = {
        path.name
        for path in folder.glob("*.py")
        for row in ROWS
        if row.allows(folder, path.name)
        and folder.name in row.where
        and "every" not in " ".join(row.where)
    }
    named = named_in_docstring(folder)

    assert named <= {path.name for path in folder.glob("*.py")}
    assert special <= named


@pytest.mark.parametrize(
    "folder",
    sorted({path.parent for part in PARTS for path in PACKAGE.rglob(f"{part}/*.py")}),
    ids=lambda folder: f"{folder.parent.name}-{folder.name}",
)
def test_docstring_of_parts_names_all_files(folder: Path) -> None:
    """The docstring of `emulation/` and of `profiles/` names every file beside it."""
    files = {path.name for path in folder.glob("*.py")} - {"__init__.py"}

    assert named_in_docstring(folder) == files
