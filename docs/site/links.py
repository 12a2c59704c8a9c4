"""Links out of `docs/`: each linked file of the repository becomes a page of the site.

The site then needs no forge. Markdown stays Markdown, a folder becomes a list of its files, and any
other file is shown as code. A notebook becomes a page, too.
"""

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from docs.site.notebooks import notebook_page

DOCS: Final = Path(__file__).resolve().parents[1]
ROOT: Final = DOCS.parent
OUTSIDE: Final = "project"
"""Folder of the site with the pages of files outside `docs/`."""
_LINK: Final = re.compile(r"(?<=\]\()([^)\s#:]+)(#[^)\s]*)?(?=\))")
_LANGUAGES: Final = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".service": "ini"}
_NO_SEARCH: Final = "---\nsearch: {exclude: true}\n---\n"


class Repository:
    """The files of the repository, as pages of the site."""

    def __init__(self) -> None:
        self._sources: dict[str, Path] = {}

    def pages(self) -> dict[str, str]:
        """Return the text of each page of a linked file or folder, by its URI."""
        waiting = sorted(DOCS.rglob("*.md"))
        while waiting:
            page = waiting.pop()
            for target in _targets(page):
                uri = site_uri(target)
                if _needs_page(target) and uri not in self._sources:
                    self._sources[uri] = target
                    if target.suffix == ".md":
                        waiting.append(target)
        return {uri: _page(target) for uri, target in self._sources.items()}

    def relinked(self, markdown: str, uri: str) -> str:
        """Return the text of a page with links to pages of the site.

        Args:
            markdown: The text; its links are relative to its source.
            uri: URI of the page.
        """
        source = self._sources.get(uri, DOCS / uri)
        folder = source if source.is_dir() else source.parent

        def relink(match: re.Match[str]) -> str:
            target = (folder / match[1]).resolve()
            if not target.is_relative_to(ROOT) or not target.exists():
                return match[0]
            return posixpath.relpath(site_uri(target), posixpath.dirname(uri)) + (match[2] or "")

        return _LINK.sub(relink, markdown)


def site_uri(target: Path) -> str:
    """Return the URI of the page that shows a file or a folder of the repository."""
    if target.is_dir():
        readme = target / "README.md"
        target = readme if readme.exists() else target / "index.md"
    if target.suffix == ".ipynb":
        target = target.with_suffix(".md")
    if target.is_relative_to(DOCS):
        return target.relative_to(DOCS).as_posix()
    path = target.relative_to(ROOT).as_posix()
    return f"{OUTSIDE}/{path if target.suffix == '.md' else f'{path}.md'}"


def _targets(page: Path) -> Iterator[Path]:
    """Yield the existing files and folders of the repository that a page links."""
    for target, _ in _LINK.findall(page.read_text(encoding="utf-8")):
        path = (page.parent / target).resolve()
        if path.exists() and path.is_relative_to(ROOT):
            yield path


def _needs_page(target: Path) -> bool:
    """Return whether mkdocs does not find a page of the target in `docs/` by itself."""
    if target.is_dir():
        return not (target.is_relative_to(DOCS) and (target / "README.md").exists())
    return target.suffix == ".ipynb" or not target.is_relative_to(DOCS)


def _page(target: Path) -> str:
    path = target.relative_to(ROOT)
    if target.is_dir() and (target / "README.md").exists():
        target = target / "README.md"
    if target.is_dir():
        return f"{_NO_SEARCH}# `{path}/`\n\n" + "\n".join(map(_item, sorted(target.iterdir())))
    if target.suffix == ".ipynb":
        return notebook_page(target)
    text = target.read_text(encoding="utf-8")
    if target.suffix == ".md":
        return text
    fence = f"```{_LANGUAGES.get(target.suffix, 'text')}"
    return f"{_NO_SEARCH}# `{path}`\n\n{fence}\n{text.rstrip()}\n```\n"


def _item(path: Path) -> str:
    if path.suffix != ".md":
        return f"- `{path.name}{'/' if path.is_dir() else ''}`"
    title = path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
    return f"- [{title}]({path.name})"
