"""The man page."""

import re

import pytest

from piezod.cli.client_verbs import client_verbs
from piezod.cli.main import OWN_VERBS
from tests.cli.conftest import Command
from tests.man_page import PAGE, page

GROUP_VERBS = (
    "status", "arm", "wave", "play", "hold", "resume", "disarm", "stop", "estop",
    "record", "record start", "record stop",
)  # fmt: skip
SEVERAL = {"list", "group", *(f"group {verb}" for verb in GROUP_VERBS)}
MACROS = (r"\"", "TH", "SH", "SS", "PP", "TP", "B", "nh", "ad")


def test_page_is_up_to_date() -> None:
    """If this fails, `python -m tests.man_page` writes the page anew."""
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_verb_has_a_section() -> None:
    """The verbs of a running stage and the others are there, families with each of their verbs."""
    sections = set(re.findall(r'^\.SS "piezod (.*)"$', page(), re.M))

    own = {verb.__name__.replace("_", r"\-") for verbs in OWN_VERBS.values() for verb in verbs}
    asked = {verb.words for verb in client_verbs()}
    families = {words.partition(" ")[0] for words in asked if " " in words}
    of_files = {f"record {word}" for word in ("show", "plot", "export", "replay", "repair")}
    assert sections == own | asked | families | of_files | SEVERAL


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
