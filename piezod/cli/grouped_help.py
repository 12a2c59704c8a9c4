"""Help with commands under headings, in plain text, because rich doubles the time for help."""

from typing import Any, Final

from typer.core import TyperGroup

_WHOLE_SENTENCE: Final = 1000
"""Longest first sentence in the list, in characters; click cuts it at 45."""


class GroupedHelp(TyperGroup):
    """A group of commands whose help lists each command under its `rich_help_panel`."""

    # Typer has its own copy of click's types since 0.20, hence Any.
    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each heading, in the order of their first commands."""
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
