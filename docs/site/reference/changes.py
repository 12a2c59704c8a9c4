"""Upgrade notes: what has changed for users, from the changelog."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

CHANGELOG: Final = Path(__file__).resolve().parents[3] / "CHANGELOG.md"
_VERSION: Final = re.compile(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_UPGRADING: Final = "### Upgrading\n"


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# Upgrade notes"
    yield ""
    yield "What may concern you when you upgrade: the part Upgrading of each version in the"
    yield "[changelog](../project/CHANGELOG.md)."
    for version, text in _VERSION.findall(CHANGELOG.read_text(encoding="utf-8")):
        if _UPGRADING in text:
            yield f"\n## {version}\n"
            yield _from_here(text.partition(_UPGRADING)[2].strip())


def _from_here(items: str) -> str:
    """Return items whose links are relative to the folder of this page."""
    return re.sub(r"\]\(docs/", "](../", items)
