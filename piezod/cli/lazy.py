"""Commands that are imported by name, when they run or show their own help.

So `piezod --help` and the completion of names need none of their modules. For the help of a command
its module is imported: it has the options, and imports within its function only what takes a
second to import (numba, scipy, matplotlib, servers), often from a module with `run` in its name.

Help is plain text with the commands under headings, because rich doubles the time that help takes.
"""

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any, Final, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

PLAIN: Final = "move.plain_verb"
"""Module whose function of that name returns the function of a verb, by its words."""
_WITH_POSITIONS: Final = ("goto", "wave")
"""Verbs with positions, of which a negative one begins with a dash, as options do."""
_WHOLE_SENTENCE: Final = 1000
"""Longest first sentence in the list, in characters; click cuts it at 45."""


class Verb(NamedTuple):
    """A command in the list of commands."""

    words: str  #: The words after `piezod`.
    heading: str  #: Heading in `piezod --help`.
    help: str  #: First sentence of its help; for a verb of the table of commands, all of it.
    place: str  #: Module below `piezod.cli`, and ":function" if it is not named as the verb.
    in_table: bool = False  #: Whether the table of commands has its help, not its function.


class LazyCommand(TyperCommand):
    """A command of which only name, heading and first sentence are known before it is used."""

    def __init__(self, verb: Verb) -> None:
        families, _, name = verb.words.rpartition(" ")
        panel = None if families else verb.heading
        super().__init__(name, help=verb.help, rich_help_panel=panel)
        self._verb = verb

    def load(self) -> TyperCommand:
        """Return the command with its options."""
        verb, name = self._verb, str(self.name)
        alone = typer.Typer(
            add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False
        )
        alone.command(
            name,
            help=verb.help if verb.in_table else None,
            rich_help_panel=self.rich_help_panel,
            context_settings={"ignore_unknown_options": verb.words in _WITH_POSITIONS},
        )(_function(verb, name))
        command = typer.main.get_command(alone)
        assert isinstance(command, TyperCommand)  # noqa: S101 - a program of one command is it
        return command

    # Typer has its own copy of click's types since 0.20, hence Any.
    def make_context(
        self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any
    ) -> Any:
        """Return the context of the loaded command, which then runs."""
        try:
            return self.load().make_context(info_name, args, parent, **extra)
        except typer.BadParameter as error:
            from pydantic import ValidationError

            from piezod.config.messages import describe

            if isinstance(error.__cause__, ValidationError):
                error.message = describe(error.__cause__.errors()[0], ())
            raise


def _function(verb: Verb, name: str) -> Callable[..., None]:
    module, _, own_name = verb.place.partition(":")
    functions = vars(import_module(f"piezod.cli.{module}"))
    function: Callable[..., None]
    if verb.place == PLAIN:
        function = functions["plain_verb"](verb.words)
    else:
        function = functions[own_name or name.replace("-", "_")]
    return function


class Family(TyperGroup):
    """A group of commands, whose help lists each command under its heading."""

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


def commands_of(verbs: Iterable[Verb], families: Mapping[str, str]) -> dict[str, Any]:
    """Return the commands of a program, by their first words.

    Args:
        verbs: The commands, in the order of help.
        families: Help of each family, by its words; it stands where its first command is.
    """
    groups: dict[str, dict[str, Any]] = {"": {}}
    for verb in verbs:
        outer, words = "", verb.words.split()
        for word in words[:-1]:
            inner = f"{outer} {word}".lstrip()
            if inner not in groups:
                groups[inner] = {}
                groups[outer][word] = Family(
                    name=word,
                    commands=groups[inner],
                    help=families[inner],
                    no_args_is_help=True,
                    rich_markup_mode=None,
                    rich_help_panel=None if outer else verb.heading,
                )
            outer = inner
        groups[outer][words[-1]] = LazyCommand(verb)
    return groups[""]
