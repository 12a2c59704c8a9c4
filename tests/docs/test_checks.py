"""The check of blocks that are not run finds what does not exist."""

import pytest

from tests.docs.blocks import Block
from tests.docs.checks import mistakes


def block(language: str, text: str) -> Block:
    """Return a block of a page."""
    return Block("page.md", 1, language, "", "not run", "a reason", text)


@pytest.mark.parametrize(
    "text",
    [
        "piezod goto 12.5 --wait && piezod status --json   # a comment\n",
        "piezod metrics | grep piezod_state\n",
        "setpriv --reuid=piezod \\\n  env A=1 /opt/piezod/bin/piezod safe FILE.yaml\n",
        "make demo\npython -m benchmarks.peers --record stack\n",
        "systemctl stop piezod@stage1\n",
    ],
)
def test_right_commands_pass(text: str) -> None:
    """Commands that exist, with options that they have, give no mistake."""
    assert mistakes(block("sh", text)) == []


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("piezod fly\n", "no command fly"),
        ("piezod record begin\n", "no command begin"),
        ("piezod status && piezod goto 12.5 --wiat\n", "--wiat"),
        ("env A=1 /opt/piezod/bin/piezod safe --sofe FILE\n", "--sofe"),
        ("make no-such-target\n", "no target no-such-target"),
        ("python -m benchmarks.none\n", "no module benchmarks.none"),
        ("frobnicate\n", "no program frobnicate"),
    ],
)
def test_wrong_commands_are_found(text: str, what: str) -> None:
    """Each wrong command gives one mistake, which names it."""
    (mistake,) = mistakes(block("sh", text))

    assert what in mistake


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("import piezod.none\n", "piezod.none"),
        ("from piezod.client import StageKlient\n", "StageKlient"),
    ],
)
def test_wrong_names_of_python_are_found(text: str, what: str) -> None:
    """A module or a name that does not exist gives one mistake."""
    (mistake,) = mistakes(block("python", text))

    assert what in mistake


def test_python_must_compile() -> None:
    """A block with an error of syntax is not accepted."""
    with pytest.raises(SyntaxError):
        mistakes(block("python", "with StageClient() as\n"))
