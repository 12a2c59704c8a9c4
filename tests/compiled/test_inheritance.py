"""What can be compiled: an interpreted class cannot inherit from a compiled one."""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = (ROOT / "piezod", ROOT / "drivers" / "piezod_drivers")


def module_of(file: Path) -> str:
    """Return the name of the module in a file of the product."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[1:] if parts[0] == "drivers" else parts)


def inherited(file: Path) -> Iterator[tuple[str, str]]:
    """Yield each class of a file, and the module of each of its bases, where that is imported."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    modules = {
        alias.asname or alias.name: node.module or ""
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for base in node.bases:
                named = base.value if isinstance(base, ast.Subscript) else base
                if isinstance(named, ast.Name) and named.id in modules:
                    yield node.name, modules[named.id]


def test_no_interpreted_class_inherits_from_a_compiled_one() -> None:
    """It would fail at the moment at which it is defined, as late as its module is imported."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    compiled = {
        name.removesuffix(".py").replace("/", ".")
        for name in settings["tool"]["piezod"]["compiled"]
    }
    files = [file for package in PACKAGES for file in sorted(package.rglob("*.py"))]
    assert compiled <= {module_of(file) for file in files}
    found = [
        f"{module_of(file)}.{name} inherits from {base}"
        for file in files
        if module_of(file) not in compiled
        for name, base in inherited(file)
        if base in compiled
    ]
    assert not found
