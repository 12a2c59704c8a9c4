"""The man page, made from the texts of `--help`: `python -m tests.man_page` writes it.

A test compares it with the file, which the wheel installs as `share/man/man1/piezod.1`. The build
cannot make the page, because it runs without the dependencies of piezod.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from typer.main import get_command

import piezod
from piezod.cli.lazy import LazyCommand
from piezod.cli.main import app

PAGE: Final = Path(__file__).parents[1] / "docs" / "piezod.1"
HEAD: Final = r""".\" Made by `python -m tests.man_page` from the texts of --help; do not edit."""
SETTINGS: Final = (".nh", ".ad l")
"""No hyphens within words and ragged lines, so that options stay whole."""
# Typer has its own copy of click's types since 0.20, hence Any.
Command = Any
Context = Any


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the man page in the macros of man(7)."""
    return "\n".join(_page()) + "\n"


def _page() -> Iterator[str]:
    program: Command = get_command(app)
    context = program.make_context("piezod", [], resilient_parsing=True)
    summary = program.help.rstrip(".")
    yield HEAD
    yield f'.TH PIEZOD 1 "" "piezod {piezod.__version__}" "User Commands"'
    yield from SETTINGS
    yield ".SH NAME"
    yield f"piezod \\- {_text(summary[0].lower() + summary[1:])}"
    yield ".SH SYNOPSIS"
    yield from _usage(program, context)
    yield ".SH DESCRIPTION"
    yield from _paragraphs(program.help)
    yield from _paragraphs("Every command also has `--help`.")
    yield ".SH OPTIONS"
    yield from _parameters(program, context)
    for heading, words, command, inner in commands_with_headings(program, context):
        if heading:
            yield f'.SH "{_text(heading.upper())}"'
        yield f'.SS "{_text(words)}"'
        yield from _usage(command, inner)
        yield ".PP"
        yield from _paragraphs(command.help)
        yield from _parameters(command, inner)
    title, _, codes = program.epilog.partition(": ")
    yield f'.SH "{title.upper()}"'
    yield from _paragraphs(codes)


def commands_with_headings(
    program: Command, context: Context
) -> Iterator[tuple[str, str, Command, Context]]:
    """Yield each command as `commands` does, behind the heading that begins with it, or nothing."""
    last = ""
    for words, command, inner in commands(program, context):
        panel = command.rich_help_panel or last
        yield panel if panel != last else "", words, command, inner
        last = panel


def commands(group: Command, context: Context) -> Iterator[tuple[str, Command, Context]]:
    """Yield each command with its words and context; a family is followed by its commands."""
    for name in group.list_commands(context):
        command = loaded(group.commands[name])
        inner = type(context)(command, info_name=name, parent=context)
        yield inner.command_path, command, inner
        if hasattr(command, "commands"):
            yield from commands(command, inner)


def loaded(command: Command) -> Command:
    """Return a command with its options, which `piezod --help` does not load."""
    return command.load() if isinstance(command, LazyCommand) else command


def _usage(command: Command, context: Context) -> Iterator[str]:
    yield f".B {_text(context.command_path)}"
    yield _text(" ".join(command.collect_usage_pieces(context)))


def _parameters(command: Command, context: Context) -> Iterator[str]:
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None or (parameter.name == "help" and context.parent):
            continue
        names, text = record
        if parameter.param_type_name == "argument":
            names = names.partition(" <")[0]  # without the name of its type in Python
        yield ".TP"
        yield f".B {_text(names)}"
        yield from _paragraphs(text)


def _paragraphs(text: str) -> Iterator[str]:
    """Yield the lines of a text; its paragraphs are parted by a request of roff."""
    for number, paragraph in enumerate(text.split("\n\n")):
        if number:
            yield ".PP"
        yield _text(" ".join(paragraph.split()))


def _text(text: str) -> str:
    """Return a text as roff: its signs are plain characters, and words in backticks are bold."""
    plain = text.replace("\\", "\\e").replace("-", "\\-").replace('"', "\\(dq")
    bold = re.sub(r"`([^`]+)`", r"\\fB\1\\fR", plain)
    # A line that begins with one of these would be a request.
    return f"\\&{bold}" if bold.startswith((".", "'")) else bold


if __name__ == "__main__":
    main()
