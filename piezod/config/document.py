"""A parsed document: plain data, and the place of each part in the file."""

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
    """Plain data with places."""

    file: str  #: Path of the file as the user gave it.
    #: The top level. Mappings are dicts with text keys, sequences are tuples, all else is None,
    #: bool, int, float or str.
    data: dict[str, Any]
    #: Place of the value of each path; the top level has the path `()`.
    values: Mapping[KeyPath, SourcePlace]
    #: Place of the key of each path that ends in a key of a mapping.
    keys: Mapping[KeyPath, SourcePlace]

    def problem(self, path: KeyPath, what: str, *, at_key: bool = False) -> Problem:
        """Return a problem with its place.

        Args:
            path: Path of the problem. If it is not in the file, the nearest enclosing part gives
                the place.
            what: Description of the problem.
            at_key: Whether to report the place of the key instead of the value.
        """
        present = path
        while present not in self.values:
            present = present[:-1]
        absent = len(present) < len(path)  # a missing key is reported at the key of its mapping
        places = self.keys if (at_key or absent) and present in self.keys else self.values
        return Problem(self.file, *places[present], format_path(path), what)


def format_path(path: KeyPath) -> str:
    """Return a path in readable form: `cases[0].command_um.frequency_hz`."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if part.isprintable() and part else repr(part)
            text += f".{name}" if text else name
    return text


def config_error(problems: Iterable[Problem]) -> ConfigError:
    """Return the error of all problems, in the order of the file.

    Of more than fifty problems, the first fifty and the number of the others are reported.
    """
    # The validation reports them in the order of the model.
    ordered = sorted(problems, key=lambda problem: (problem.line, problem.column))
    kept = ordered[:MAX_PROBLEMS]
    if len(ordered) > len(kept):
        what = f"{len(ordered) - len(kept)} more problems are not shown"
        kept.append(Problem(kept[0].file, 0, 0, "", what))
    return ConfigError(*kept)
