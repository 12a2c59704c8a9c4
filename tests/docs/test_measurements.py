"""The appendix of measurements is what its command writes."""

from docs.measured.__main__ import MADE, appendix
from docs.measured.tables import FOLDER, PAGE, names

TEXT = PAGE.read_text(encoding="utf-8")


def test_the_page_is_the_one_that_the_command_writes() -> None:
    """`python -m docs.measured` was run after the last change of a result, a mark or a figure."""
    assert appendix() == TEXT


def test_every_result_is_shown() -> None:
    """Each stored result has its place on the page, once, and so has what the code makes."""
    stored = {file.stem for kind in ("csv", "json") for file in FOLDER.glob(f"*.{kind}")}

    assert sorted(names(TEXT)) == sorted(stored | set(MADE))
