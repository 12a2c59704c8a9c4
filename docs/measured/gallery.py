"""The gallery: every image of the documentation, with the words of the page that shows it."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from docs.measured.tables import PAGE

DOCS: Final = PAGE.parent
IMAGES: Final = DOCS / "images"
_IMAGE: Final = re.compile(r"!\[([^\]]+)\]\((?:\S*/)?images/(\S+)\)")


def gallery() -> Iterator[str]:
    """Yield the images by page, and at the end those that no page shows."""
    shown: set[str] = set()
    for page in (
        DOCS.parent / "README.md",
        *sorted(DOCS.rglob("*.md")),
        DOCS.parent / "drivers/README.md",
    ):
        if page == PAGE:
            continue
        text = page.read_text(encoding="utf-8")
        found = [each for each in _IMAGE.findall(text) if each[1] not in shown]
        shown |= {name for _, name in found}
        if found:
            title = text.partition("\n")[0].removeprefix("# ")
            yield from ("", f"[{title}]({_relative(page)}):")
            yield from _images(found)
    others = sorted(image.name for image in IMAGES.iterdir() if image.name not in shown)
    yield from ("", "On no other page:")
    yield from _images([(Path(name).stem.replace("-", " "), name) for name in others])


def _images(found: list[tuple[str, str]]) -> Iterator[str]:
    for words, name in found:
        yield from ("", f"![{words}](images/{name})")


def _relative(page: Path) -> str:
    if page.is_relative_to(DOCS):
        return page.relative_to(DOCS).as_posix()
    return f"../{page.relative_to(DOCS.parent).as_posix()}"
