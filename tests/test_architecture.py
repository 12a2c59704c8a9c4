"""Rules of the architecture that import contracts cannot express."""

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Third-party packages that a room may import; import-linter checks the imports within piezod.
OUTSIDE_WORLD = {
    "piezod/hysteresis": {"numpy", "scipy"},
    "piezod/plant": {"numpy"},
    "piezod/control": {"numpy"},
    "piezod/devices": {"numpy", "pydantic", "serial"},  # numpy: types of the tables of a player
    "piezod/testing": set(),
}
# Implementations of `Line` and `FrameBus`, which wait for bytes until a deadline; only they may.
HAVE_A_CLOCK = {
    ROOT / "piezod/devices/bus/serial_line.py",
    ROOT / "piezod/devices/bus/tcp_line.py",
    ROOT / "drivers/piezod_drivers/can_bus/library_bus.py",
    ROOT / "drivers/piezod_drivers/serial_line/thorlabs_apt/cube_line.py",
}
MAX_LINES = 500  # of a test; `tests.house` has the limit of the product


@cache
def imported_by(file: Path) -> frozenset[str]:
    """Return the top-level packages of all imports in a file."""
    nodes = list(ast.walk(ast.parse(file.read_text())))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return frozenset(name.partition(".")[0] for name in names)


def imported(folder: Path) -> Iterator[str]:
    """Yield the top-level package of every import in a folder."""
    for file in folder.rglob("*.py"):
        yield from imported_by(file)


@pytest.mark.parametrize("room", OUTSIDE_WORLD)
def test_room_imports_only_the_libraries_it_may(room: str) -> None:
    """No room imports a library that is not on its list."""
    foreign = set(imported(ROOT / room)) - sys.stdlib_module_names - {"piezod"}

    assert foreign <= OUTSIDE_WORLD[room]


@pytest.mark.parametrize("module", ["time", "datetime"])
@pytest.mark.parametrize(
    "folder", ["piezod/hysteresis", "piezod/plant", "piezod/control", "piezod/devices", "drivers"]
)
def test_nothing_in_the_loop_reads_a_clock(folder: str, module: str) -> None:
    """Code below the pacing of the loop gets the time as an argument."""
    files = set((ROOT / folder).rglob("*.py")) - HAVE_A_CLOCK

    assert not [file for file in files if module in imported_by(file)]


def test_no_test_file_is_too_long_to_read() -> None:
    """No test file has more than `MAX_LINES` lines."""
    files = ROOT.glob("tests/**/*.py")
    lengths = {str(file.relative_to(ROOT)): len(file.read_text().splitlines()) for file in files}

    assert {name: n for name, n in lengths.items() if n > MAX_LINES} == {}
