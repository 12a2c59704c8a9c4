"""Reading of a file into YAML events, with every error as file, line and column."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Final

import yaml

from piezod.config.document import SourcePlace
from piezod.errors import ConfigError, DataError, Problem
from piezod.given_file import read_given

MAX_BYTES: Final = 256 * 1024

# Absent if PyYAML was built without libyaml.
_FAST_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_REMEDIES: Final = {
    "mapping values are not allowed here": "check the indentation, quote a text with ': ' in it",
    "could not find expected ':'": "a key needs ': ' after it",
    "found character '\\t' that cannot start any token": "indent with spaces, not with tabs",
}


def read_text(path: Path) -> str:
    """Read a text file of bounded size.

    Raises:
        ConfigError: If it cannot be read, is too large, or is not UTF-8.
    """
    try:
        raw = read_given(path, MAX_BYTES)
    except DataError as error:
        what = str(error).removeprefix(f"{path}: ")
        raise ConfigError(Problem(str(path), 0, 0, "", what)) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(Problem(str(path), 0, 0, "", f"cannot be read: {reason}")) from error
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = error.object[: error.start].decode("utf-8-sig")
        what = f"not UTF-8 (got byte 0x{error.object[error.start]:02x}), save the file as UTF-8"
        raise ConfigError(Problem(str(path), *_place_after(before), "", what)) from error


def parse_events(text: str, file: str) -> Iterator[yaml.Event]:
    """Yield the events of a text.

    Raises:
        ConfigError: If the text is not valid YAML; `file` is its name in the message.
    """
    place = SourcePlace(1, 1)
    try:
        for event in _events(text):
            place = start_of(event)
            yield event
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = SourcePlace(mark.line + 1, mark.column + 1) if mark else place
        raise ConfigError(Problem(file, *place, "", _explain(error))) from error
    except yaml.reader.ReaderError as error:
        what = f"character {chr(error.character)!a} is not allowed in YAML"
        place = _place_after(text[: error.position])
        raise ConfigError(Problem(file, *place, "", what)) from error
    except (ValueError, OverflowError) as error:
        # PyYAML converts the digits of escapes and directives without checking their size.
        what = "an escape or directive near here has a number that is too large"
        raise ConfigError(Problem(file, *place, "", what)) from error


def _events(text: str) -> Iterator[yaml.Event]:
    """Yield the events from libyaml, 19 times as fast as PyYAML's parser, whose errors say more."""
    passed = 0
    try:
        for event in yaml.parse(text, Loader=_FAST_LOADER):
            yield event
            passed += 1
    except (yaml.YAMLError, ValueError):
        yield from islice(yaml.parse(text, Loader=yaml.SafeLoader), passed, None)


def start_of(event: yaml.Event) -> SourcePlace:
    """Return the place where an event starts."""
    mark = event.start_mark
    return SourcePlace(mark.line + 1, mark.column + 1) if mark else SourcePlace(1, 1)


def _place_after(text: str) -> SourcePlace:
    lines = text.split("\n")
    return SourcePlace(len(lines), len(lines[-1]) + 1)


def _explain(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or "not YAML"
    parts = [error.context, problem, _REMEDIES.get(problem)]
    return ", ".join(part for part in parts if part)
