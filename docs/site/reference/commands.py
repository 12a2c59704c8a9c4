"""The commands, from their help."""

from collections.abc import Iterator
from typing import Any

from typer.main import get_command

from docs.site.reference.text import code, one_line, table
from piezod.cli.main import app
from tests.man_page import commands_with_headings


def page() -> Iterator[str]:
    """Yield the page."""
    program: Any = get_command(app)
    context = program.make_context("piezod", [], resilient_parsing=True)
    yield "# Commands"
    yield ""
    yield one_line(program.help)
    yield ""
    yield "Every command also has `--help`."
    yield from _parameters(program, context)
    for heading, words, command, inner in commands_with_headings(program, context):
        if heading:
            yield f"\n## {heading}\n"
        usage = " ".join(command.collect_usage_pieces(inner))
        yield f"\n### `{words}` {{ #{words.replace(' ', '-')} }}\n"
        yield f"```text\n{words} {usage}\n```\n"
        yield from ("\n".join(map(one_line, command.help.split("\n\n"))).replace("\n", "\n\n"), "")
        yield from _parameters(command, inner)
    title, _, codes = program.epilog.partition(": ")
    yield f"\n## {title}\n"
    yield one_line(codes)


def _parameters(command: Any, context: Any) -> Iterator[str]:
    records = (
        parameter.get_help_record(context)
        for parameter in command.get_params(context)
        if parameter.name != "help"  # every command has it
    )
    # The name of an argument, without that of its type in Python.
    rows = ((code(name.partition(" <")[0]), text) for name, text in filter(None, records))
    yield from table(("option", "meaning"), rows)
