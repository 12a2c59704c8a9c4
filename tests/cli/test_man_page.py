"""The man page."""

import re

import pytest

from piezod.cli.verbs import FAMILIES, VERBS
from tests.cli.conftest import Command
from tests.man_page import PAGE, page

MACROS = (r"\"", "TH", "SH", "SS", "PP", "TP", "B", "nh", "ad")


def test_page_is_up_to_date() -> None:
    """If this fails, `python -m tests.man_page` writes the page anew."""
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_verb_has_a_section() -> None:
    """All commands are there, and families before their commands."""
    sections = re.findall(r'^\.SS "piezod (.*)"$', page(), re.M)

    assert {each.replace(r"\-", "-") for each in sections} == {*VERBS, *FAMILIES}


def test_each_heading_stands_once() -> None:
    """Verbs and families of a heading are in one section."""
    headings = re.findall(r"^\.SH .*$", page(), re.M)

    assert sorted(headings) == sorted(set(headings))


def test_texts_are_no_requests() -> None:
    """Only the macros of the page begin a line with a dot; no text begins one with a quote."""
    requests = [line for line in page().splitlines() if line.startswith((".", "'"))]

    assert [line for line in requests if line[1:].split()[0] not in MACROS] == []


@pytest.mark.parametrize("verb", ["identify", "goto"])
def test_texts_are_those_of_help(piezod: Command, verb: str) -> None:
    """Except for hints at the markup, a section reads as the help of the verb."""
    section = page().partition(f'.SS "piezod {verb}"\n')[2].partition("\n.S")[0]
    plain = re.sub(r"^\.\w+ ?", "", section, flags=re.M)
    for roff, sign in ((r"\fB", "`"), (r"\fR", "`"), (r"\-", "-"), (r"\(dq", '"')):
        plain = plain.replace(roff, sign)

    _, help_text, _ = piezod(verb, "--help")

    lines = [line.strip() for line in plain.splitlines() if len(line) > 40]
    assert len(lines) > 3
    shown = "".join(help_text.split())
    assert [line for line in lines if "".join(line.split()) not in shown] == []
