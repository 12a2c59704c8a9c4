"""Upgrade notes: what has changed for users, from the changelog."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

CHANGELOG: Final = Path(__file__).resolve().parents[3] / "CHANGELOG.md"
_VERSION: Final = re.compile(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_PART: Final = re.compile(r"^### ([^\n]+)\n(.*?)(?=^### |\Z)", re.MULTILINE | re.DOTALL)
_CONCERNS_USERS: Final = {"Changed", "Deprecated", "Removed"}


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# Upgrade notes"
    yield ""
    yield "What may concern you when you upgrade: the parts Changed, Deprecated and Removed of the"
    yield "[changelog](../project/CHANGELOG.md). Install the new version, run `piezod check` on"
    yield "your files, and restart the service. Files of older versions stay readable."
    for version, text in _VERSION.findall(CHANGELOG.read_text(encoding="utf-8")):
        parts = [part for part in _PART.findall(text) if part[0] in _CONCERNS_USERS]
        if parts:
            yield f"\n## {version}\n"
        for title, items in parts:
            yield f"### {title}\n\n{_from_here(items.strip())}\n"


def _from_here(items: str) -> str:
    """Return items whose links are relative to the folder of this page."""
    return re.sub(r"\]\(docs/", "](../", items)
