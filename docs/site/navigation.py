"""The navigation of the site, from the table of contents `docs/README.md`."""

import re
from pathlib import Path
from typing import Any, Final

from docs.site.links import DOCS, ROOT, site_uri
from docs.site.reference import REFERENCE, UPGRADE

CONTENTS: Final = DOCS / "README.md"
_SECTION: Final = re.compile(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_ROW: Final = re.compile(r"^\| \[(.+?)\]\((\S+?)\) \|", re.MULTILINE)
_MADE: Final = {"Reference": REFERENCE, "Project": {"Upgrade notes": UPGRADE}}
"""Pages made from the code, which begin their sections."""


def navigation() -> list[Any]:
    """Return the navigation: a section for each heading that has a table of pages."""
    sections: list[Any] = [{"Home": "README.md"}]
    for title, text in _SECTION.findall(CONTENTS.read_text(encoding="utf-8")):
        made = [{name: uri} for name, uri in _MADE.get(title, {}).items()]
        rows = [_entry(name, target) for name, target in _ROW.findall(text)]
        if made or rows:
            sections.append({title: [*made, *rows]})
    return sections


def _entry(name: str, target: str) -> dict[str, Any]:
    path = (DOCS / target).resolve()
    uri = site_uri(path)
    if not path.is_dir():
        return {name: uri}
    pages = sorted(page for page in path.glob("*.md") if page.name != "README.md")
    return {name: [uri, *(str(page.relative_to(DOCS)) for page in pages)]}


def listed() -> list[Path]:
    """Return the files and folders that the table of contents links, relative to the repository."""
    text = CONTENTS.read_text(encoding="utf-8")
    return [(DOCS / target).resolve().relative_to(ROOT) for _, target in _ROW.findall(text)]
