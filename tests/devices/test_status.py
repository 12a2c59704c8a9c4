"""Each flag that a device may report."""

import ast
from pathlib import Path

from piezod.devices.status import DeviceFlag

ROOT = Path(__file__).parents[2]
READERS = ("piezod/control/", "piezod/testing/", "piezod/commission/", "piezod/experiment/")
"""Folders whose modules react to flags, or inject them, and never report one of their own."""


def reported() -> set[str]:
    """Return the names of the flags that drivers, lines or wrappers of devices have."""
    names = set()
    for path in [*(ROOT / "piezod").rglob("*.py"), *(ROOT / "drivers").rglob("*.py")]:
        text = path.read_text("utf-8")
        if path.relative_to(ROOT).as_posix().startswith(READERS) or "DeviceFlag." not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                names |= {node.attr} if node.value.id == "DeviceFlag" else set()
    return names


def test_each_flag_is_reported_by_some_module() -> None:
    """A flag that no module reports would be a fault that is promised and never appears."""
    assert set(DeviceFlag.__members__) - reported() == set()
