"""Every block of commands and of Python in the documentation is run, or says why not."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from shutil import which

import pytest

from tests.conftest import Figure
from tests.docs.blocks import PAGES, ROOT, Block, all_blocks, blocks
from tests.docs.checks import mistakes
from tests.docs.command_server import SLOWER
from tests.docs.pages import ELSEWHERE, QUICK, SETTINGS, Setting
from tests.docs.workspace import workspace

BLOCKS = [block for block in all_blocks() if block.page not in ELSEWHERE]
RUN = sorted({block.page for block in BLOCKS if block.kind != "not run"})
LATER = [block for block in BLOCKS if block.kind or block.page not in QUICK]
"""Blocks that `make test` only checks."""
MOST_NOT_RUN = 16
DOCS_PYTHON = ROOT / "build" / "docs-env" / "bin" / "python"


def run_page(
    page: str, folder: Path, kinds: set[str], slower: Mapping[str, str], python: str = ""
) -> None:
    """Run the blocks of a page one after the other, as a reader copies them."""
    texts = [block.text for block in blocks(ROOT / page) if block.kind in kinds]
    for program in ("curl", "openssl"):
        if any(f"{program} " in text for text in texts) and which(program) is None:
            pytest.skip(f"the page uses {program}, which this machine lacks")
    setting = SETTINGS.get(page, Setting())
    with workspace(
        folder, setting.prepare, setting.words, slower, python, together=setting.together
    ) as place:
        place.shell(setting.before, f"before {page}")
        for block in blocks(ROOT / page):
            if block.kind in kinds:
                place.run(block)


@pytest.mark.parametrize("page", QUICK)
def test_quick_pages_run(page: str, tmp_path: Path) -> None:
    """The blocks of a page do what the reader expects: none fails."""
    run_page(page, tmp_path, {""}, SLOWER)


@pytest.mark.docs
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", RUN)
def test_pages_run(page: str, tmp_path: Path) -> None:
    """The same for all pages, with their long blocks, at the rate of the page."""
    run_page(page, tmp_path, {"", "long"}, {}, str(DOCS_PYTHON))


@pytest.mark.parametrize("block", LATER, ids=str)
def test_blocks_that_are_not_run_are_right(block: Block) -> None:
    """Their commands, options, modules and names exist."""
    assert mistakes(block) == []


@pytest.mark.parametrize(("page", "test"), ELSEWHERE.items())
def test_blocks_run_elsewhere(page: str, test: str) -> None:
    """A page without a test here has one of its own."""
    assert f'"{Path(page).name}"' in (ROOT / test).read_text(encoding="utf-8")


def test_few_blocks_are_not_run(figure: Figure) -> None:
    """Blocks that no test runs are few, and each has its reason."""
    count = Counter(block.kind for block in BLOCKS)
    others, quick = len(all_blocks()) - len(BLOCKS), len(BLOCKS) - len(LATER)
    later = len(LATER) - count["not run"]
    for block in BLOCKS:
        if block.kind == "not run":
            figure(f"docs: not run: {block}: {block.reason}")
    figure(
        f"docs: {len(all_blocks())} blocks of {len(PAGES)} pages: {quick} run by `make test`, "
        f"{others} by tests of their pages, {later} by `make docs-test`, {count['not run']} not run"
    )

    assert count["not run"] <= MOST_NOT_RUN
    assert all(len(block.reason) > 10 for block in BLOCKS if block.kind)
