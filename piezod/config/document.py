"""A document that has been read: plain data, and where in the file each part of it stands."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

from piezod.errors import ConfigError, Problem

KeyPath: TypeAlias = tuple[str | int, ...]
MAX_PROBLEMS: Final = 50


class SourcePlace(NamedTuple):
    """Line and column in a file, both counted from 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Document:
    """Plain data with its places.

    Attributes:
        file: Path of the file as the user gave it.
        data: The top level. Mappings are dicts with text keys, sequences are tuples, the rest is
            None, bool, int, float or str.
        values: Where the value at a path starts; the top level has the path `()`.
        keys: Where the key of a path stands, for every path that ends in a key of a mapping.
    """

    file: str
    data: dict[str, Any]
    values: Mapping[KeyPath, SourcePlace]
    keys: Mapping[KeyPath, SourcePlace]

    def problem(self, path: KeyPath, what: str, *, at_key: bool = False) -> Problem:
        """Place a problem.

        Args:
            path: What the problem is about. If it is not in the file, the nearest thing around it
                gives the place.
            what: What is wrong.
            at_key: Whether to point at the key rather than at its value.
        """
        present = path
        while present not in self.values:
            present = present[:-1]
        absent = len(present) < len(path)
        places = self.keys if (at_key or absent) and present in self.keys else self.values
        return Problem(self.file, *places[present], format_path(path), what)


def format_path(path: KeyPath) -> str:
    """Write a path as a person would: `cases[0].command_um.frequency_hz`."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            shown = part if part.isprintable() and part else repr(part)
            text += f".{shown}" if text else shown
    return text


def config_error(problems: Iterable[Problem]) -> ConfigError:
    """Make the error of all that has been collected, in the order of the file.

    A file with a flood of problems gets the first fifty and how many more there are.
    """
    ordered = sorted(problems, key=lambda problem: (problem.line, problem.column))
    kept = ordered[:MAX_PROBLEMS]
    if len(ordered) > len(kept):
        what = f"{len(ordered) - len(kept)} more problems are not shown"
        kept.append(Problem(kept[0].file, 0, 0, "", what))
    return ConfigError(*kept)
