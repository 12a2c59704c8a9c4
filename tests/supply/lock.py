"""The lock files and what they pin, and what `pyproject.toml` asks for."""

import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from packaging.requirements import Requirement

ROOT: Final = Path(__file__).parents[2]
LOCK: Final = ROOT / "requirements.lock"
TOOLS: Final = ROOT / ".ci" / "tools"
_PIN: Final = re.compile(r"^[A-Za-z0-9._-]+==[^ \\]+(?: ; [^\\]+)?", re.MULTILINE)


def pins(lock: str) -> list[str]:
    """Return what the text of a lock file pins, each with its marker if it has one."""
    return [each.rstrip() for each in _PIN.findall(lock)]


def pinned(lock: Path) -> list[Requirement]:
    """Return what a lock file pins."""
    return [Requirement(each) for each in pins(lock.read_text(encoding="utf-8"))]


def project() -> dict[str, Any]:
    """Return the table `project` of `pyproject.toml`."""
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return table


def named(extras: Iterable[str]) -> Iterator[Requirement]:
    """Yield what `pyproject.toml` asks for, with some extras; without piezod itself."""
    table = project()
    texts = [*table["dependencies"]]
    for extra in extras:
        texts += table["optional-dependencies"][extra]
    for text in texts:
        requirement = Requirement(text)
        if requirement.name != table["name"]:
            yield requirement
