"""The measures of the house, and what CONTRIBUTING shows of it."""

import re
from collections.abc import Callable

import pytest

from piezod.control.stage.requests import HANDLERS
from piezod.messages.requests import REQUESTS
from tests.house import EXAMPLE, MEASURES, ROOT, Measure, files_of_a_verb

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## A new verb\n")[2].partition("\n## ")[0]
EXCERPTS = re.findall(r"`(piezod/[\w/]+\.py)`.*?```python\n(.*?)```", SECTION, flags=re.DOTALL)


def unindented(text: str) -> str:
    """Return a text with its lines at the left margin."""
    return "\n".join(line.strip() for line in text.splitlines())


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.__name__)
def test_measure_is_within_its_limit(measure: Callable[[], Measure]) -> None:
    """No count exceeds its limit."""
    measured = measure()

    assert measured.number <= measured.limit, measured


def test_the_files_of_the_example_are_those_that_the_page_shows() -> None:
    """CONTRIBUTING names every file that a new verb needs."""
    assert {file for file, _ in EXCERPTS} == set(files_of_a_verb().found)


@pytest.mark.parametrize(("file", "excerpt"), EXCERPTS)
def test_the_page_shows_the_code_as_it_is(file: str, excerpt: str) -> None:
    """Each part of an excerpt is in its file; `...` stands for what the page leaves out."""
    source = unindented((ROOT / file).read_text(encoding="utf-8"))

    assert [part for part in unindented(excerpt).split("\n...") if part.strip() not in source] == []


def test_every_request_has_a_handler() -> None:
    """The loop can carry out each request class, and the stream's."""
    assert set(REQUESTS.values()) < set(HANDLERS)
    assert {kind.__name__ for kind in set(HANDLERS) - set(REQUESTS.values())} == {"Stream"}
    assert EXAMPLE in REQUESTS
