"""Help that lists verbs under headings, as plain text: rich doubles the time that help takes."""

from typing import Any, Final

from typer.core import TyperGroup

_WHOLE_SENTENCE: Final = 1000
"""Help shows the first sentence of a verb uncut; click's default is 45 letters."""


class GroupedHelp(TyperGroup):
    """A command whose help lists each verb under its `rich_help_panel`."""

    # Typer has its own copy of click's types since 0.20, hence Any.
    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each heading, in the order in which verbs first name them."""
        sections: dict[str, list[tuple[str, str]]] = {}
        names = self.list_commands(ctx)
        width = max(map(len, names))
        for name in names:
            command = self.commands[name]
            sentence = command.get_short_help_str(_WHOLE_SENTENCE)
            heading = getattr(command, "rich_help_panel", None) or "Commands"
            sections.setdefault(heading, []).append((name.ljust(width), sentence))
        for heading, lines in sections.items():
            with formatter.section(heading):
                formatter.write_dl(lines)
