"""The help, and the commands that derive from the table of commands."""

import subprocess
import sys

import pytest

from piezod.cli.lazy import PLAIN, LazyCommand
from piezod.cli.verbs import OWN, SEVERAL, VERBS
from piezod.messages.endpoints import Endpoint, Group
from piezod.messages.requests import TABLE
from tests.cli.conftest import Command

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

    assert list(found) == [*OWN, *Group]
    assert found[SEVERAL] == ["list", "group"]
    assert found["Experiments and models"] == [
        "demo",
        "experiment",
        "import",
        "identify",
        "voltages",
        "export-code",
        "response",
        "play",
        "scan",
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


@pytest.mark.parametrize("words", VERBS)
def test_sentence_in_the_list_is_the_first_of_the_help(words: str) -> None:
    """The list of commands has the first sentence of each command's own help."""
    verb = VERBS[words]
    listed = LazyCommand(verb)

    assert listed.get_short_help_str(1000) == listed.load().get_short_help_str(1000)


def test_every_verb_of_the_table_is_listed() -> None:
    """The command line has the verbs of the table with their helps, and no others claim one."""
    listed = {words: verb.help for words, verb in VERBS.items() if verb.in_table}

    assert listed == {row.verb: row.help for row in ROWS}


def test_verbs_without_a_text_have_functions_of_their_own() -> None:
    """A row with `done` makes a verb by itself; all others have a function, and no row has both."""
    made = {words for words, verb in VERBS.items() if verb.place == PLAIN}

    assert made == {row.verb for row in ROWS if row.done}


@pytest.mark.parametrize("row", [row for row in ROWS if row.done], ids=lambda row: row.verb)
def test_plain_verbs_have_no_field_but_the_axis(row: Endpoint) -> None:
    """A request with other fields needs a function with options for them."""
    assert row.request is not None
    assert set(row.request.model_fields) <= {"kind", "axis"}


HELP_OF_ALL = """
import sys
from piezod.cli.lazy import LazyCommand
from piezod.cli.verbs import VERBS

loaded = [LazyCommand(verb).load() for verb in VERBS.values()]
print(sorted({"matplotlib", "numba", "scipy"} & set(sys.modules)))
"""


def test_help_of_a_command_is_quick() -> None:
    """What computes and draws is imported when a command runs, not for its help."""
    ended = subprocess.run([sys.executable, "-c", HELP_OF_ALL], capture_output=True, check=True)

    assert ended.stdout == b"[]\n"
