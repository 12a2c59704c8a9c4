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


def inherited(text: str) -> Iterator[tuple[str, str]]:
    """Yield each class of a source, and the module of each of its bases, where that is imported."""
    tree = ast.parse(text)
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
    texts = {module_of(file): file.read_text(encoding="utf-8") for file in files}
    assert compiled <= set(texts)
    found = [
        f"{module}.{name} inherits from {base}"
        for module, text in texts.items()
        if module not in compiled and any(f"from {each} import" in text for each in compiled)
        for name, base in inherited(text)
        if base in compiled
    ]
    assert not found
