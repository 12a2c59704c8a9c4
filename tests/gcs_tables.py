"""The table of programs of docs/gcs.md, from their dialogues: `python -m tests.gcs_tables`.

A test compares it with what is in the page.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final

from tests.gcs.dialogues import MOVING, PROGRAMS, READY, STOP_ALL, Exchanges

PAGE: Final = Path(__file__).parents[1] / "docs" / "gcs.md"
BEGIN: Final = "<!-- programs: made by `python -m tests.gcs_tables`, begin -->\n"
END: Final = "<!-- end -->\n"
UNKNOWN: Final = "2"
"""The error of a command that is not known."""
SHOWN: Final = {MOVING: "#5", READY: "#7", STOP_ALL: "#24"}


def page() -> str:
    """Return the page with its table written anew."""
    before, begin, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{PAGE} has no marks for the table of programs")
    return "".join((before, begin, *(f"{line}\n" for line in program_table()), end, after))


def program_table() -> Iterator[str]:
    """Yield the lines of the table: the commands of each program, in their order."""
    yield "| program | commands | unknown to piezod: error 2 |"
    yield "|---|---|---|"
    for program, dialogue in PROGRAMS.items():
        unknown = set(_unknown(dialogue))
        names = dict.fromkeys(map(_name, dialogue))
        known = (name for name in names if name not in unknown)
        yield f"| {program} | {_cell(known)} | {_cell(filter(unknown.__contains__, names))} |"


def _name(exchange: tuple[str, str | None]) -> str:
    command = exchange[0].partition(" ")[0]
    return SHOWN.get(command, command)


def _unknown(dialogue: Exchanges) -> Iterator[str]:
    """Yield the commands after which `ERR?` reports that they are unknown."""
    for refused, after in pairwise(dialogue):
        if after == ("ERR?", UNKNOWN):
            yield _name(refused)


def _cell(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
