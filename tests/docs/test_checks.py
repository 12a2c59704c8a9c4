"""The check of blocks that are not run finds what does not exist."""

import pytest

from tests.docs.blocks import Block
from tests.docs.checks import mistakes


def block(language: str, text: str) -> Block:
    """Return a block of a page."""
    return Block("page.md", 1, language, "", "not run", "a reason", text)


@pytest.mark.parametrize(
    ("language", "text", "what"),
    [
        ("python", "import piezod.none\n", "piezod.none"),
        ("python", "from piezod.client import StageKlient\n", "StageKlient"),
        ("sh", "piezod fly\n", "no command fly"),
        ("sh", "piezod record begin\n", "no command begin"),
        ("sh", "piezod status && piezod goto 12.5 --wiat\n", "--wiat"),
        ("sh", "env A=1 /opt/piezod/bin/piezod safe --sofe FILE\n", "--sofe"),
        ("sh", "make no-such-target\n", "no target no-such-target"),
        ("sh", "python -m benchmarks.none\n", "no module benchmarks.none"),
        ("sh", "frobnicate\n", "no program frobnicate"),
    ],
)
def test_what_does_not_exist_is_found(language: str, text: str, what: str) -> None:
    """Each wrong command, module or name gives one mistake, which names it."""
    (mistake,) = mistakes(block(language, text))

    assert what in mistake


def test_python_must_compile() -> None:
    """A block with an error of syntax is not accepted."""
    with pytest.raises(SyntaxError):
        mistakes(block("python", "with StageClient() as\n"))
