"""Links and index of the documentation."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "drivers" / "README.md"]
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)]*)?\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    """Every local target of a link or an image exists."""
    targets = [link for link in LINK.findall(page.read_text(encoding="utf-8")) if ":" not in link]

    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_the_index_names_all_pages() -> None:
    """The index lists every page."""
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")

    assert [page.name for page in ROOT.glob("docs/*.md") if f"({page.name})" not in index] == [
        "README.md"
    ]


def test_every_room_is_described() -> None:
    """A folder that the table does not name is a room that nobody decided on."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text.partition("<!-- rooms, begin -->")[2].partition("<!-- rooms, end -->")[0]
    folders = {path.parent.name for path in ROOT.glob("piezod/*/__init__.py")}

    assert folders == set(re.findall(r"`piezod/(\w+)/`", table))
