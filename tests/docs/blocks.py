"""The code blocks of the documentation."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
LANGUAGES: Final = ("sh", "python")
_FENCE: Final = re.compile(
    r"(?:^<!-- (?P<kind>not run|long): (?P<reason>.+?) -->\n\n?)?"
    r"^(?P<indent> *)```(?P<language>\w*)(?P<label>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
"""A block, with the comment directly before it."""


class Block(NamedTuple):
    """A block of commands or of Python."""

    page: str  #: Path of the page, relative to the repository.
    line: int  #: Line of its first line.
    language: str  #: "sh" or "python".
    label: str  #: Word after the language: the file to which the code belongs.
    #: "" for a block that `make test` runs, "long" for one that `make docs-test` runs, and "not
    #: run".
    kind: str
    reason: str  #: The reason for that, of the comment before the block.
    text: str  #: The commands or the code.

    def __str__(self) -> str:
        """Return the place of the block."""
        return f"{self.page}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page with commands or Python."""
    text = page.read_text(encoding="utf-8")
    for found in _FENCE.finditer(text):
        if found["language"] in LANGUAGES:
            line = text.count("\n", 0, found.start("text")) + 1
            yield Block(
                str(page.relative_to(ROOT)),
                line,
                found["language"],
                found["label"].strip(),
                found["kind"] or "",
                found["reason"] or "",
                re.sub(rf"^{found['indent']}", "", found["text"], flags=re.MULTILINE),
            )


def all_blocks() -> list[Block]:
    """Return the blocks of all pages."""
    return [block for page in PAGES for block in blocks(page)]
