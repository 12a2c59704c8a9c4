"""The help, and the commands that derive from the table of commands."""

import pytest

from piezod.cli.client_verbs import OWN_FUNCTIONS, client_verbs
from piezod.cli.main import OWN_VERBS, SEVERAL
from piezod.messages.endpoints import Endpoint, Group
from piezod.messages.requests import TABLE
from tests.cli.conftest import Command
from tests.command_table import VERB_LIST, verb_list

ROWS = [row for row in TABLE.values() if row.verb]


def headings(out: str) -> dict[str, list[str]]:
    """Return the verbs under each heading of a help text."""
    found: dict[str, list[str]] = {}
    for line in out.splitlines():
        if line.endswith(":") and not line.startswith(" "):
            found[line[:-1]] = []
        elif found and line[:2] == "  " and line[2:3].isalpha():
            list(found.values())[-1].append(line.split()[0])
    return found


def test_help_lists_verbs_under_headings(piezod: Command) -> None:
    """Commands without a daemon come first, then those of the table in the order of its groups."""
    _, out, _ = piezod("--help")
    found = headings(out.partition("Exit codes")[0])
    del found["Options"]

    assert list(found) == [*OWN_VERBS, SEVERAL, *Group]
    assert found[SEVERAL] == ["list", "group"]
    assert found["Experiments and models"] == [
        "demo",
        "experiment",
        "identify",
        "response",
        "play",
        "check",
    ]
    assert found["Recordings"] == ["plot", "export", "replay"]
    for group in Group:
        words = dict.fromkeys(row.verb.split()[0] for row in ROWS if row.group is group)
        assert set(found[group]) == set(words)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.verb)
def test_help_of_a_verb_is_that_of_its_row(piezod: Command, row: Endpoint) -> None:
    """The command line shows the text of the table."""
    _, out, _ = piezod(*row.verb.split(), "--help")

    assert " ".join(row.help.split()) in " ".join(out.split())


def test_list_of_verbs_is_up_to_date() -> None:
    """If this fails, `python -m tests.command_table` writes the list anew."""
    assert VERB_LIST.read_text(encoding="utf-8") == verb_list()


def test_verbs_without_a_text_have_functions_of_their_own() -> None:
    """A row with `done` makes a verb by itself; all others have a function, and no row has both."""
    assert {row.verb for row in ROWS if not row.done} == OWN_FUNCTIONS.keys()
    assert {verb.words for verb in client_verbs()} == {row.verb for row in ROWS}


@pytest.mark.parametrize("row", [row for row in ROWS if row.done], ids=lambda row: row.verb)
def test_plain_verbs_have_no_field_but_the_axis(row: Endpoint) -> None:
    """A request with other fields needs a function with options for them."""
    assert row.request is not None
    assert set(row.request.model_fields) <= {"kind", "axis"}
