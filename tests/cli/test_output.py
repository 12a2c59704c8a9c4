"""Consoles and documents of commands."""

from collections.abc import Callable

import pytest
from rich.console import Console
from rich.text import Text

from piezod.cli.output import error_console, new_console


@pytest.mark.parametrize(("no_color", "styled"), [("", True), ("1", False)])
@pytest.mark.parametrize("make", [new_console, error_console])
def test_no_color_leaves_out_every_style(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[], Console],
    no_color: str,
    styled: bool,
) -> None:
    """With NO_COLOR a terminal gets no escape sequence: neither colours nor bold text."""
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")

    make().print(Text("heading", "bold red"))

    written = "".join(capsys.readouterr())
    assert ("\x1b" in written) is styled
    assert "heading" in written
