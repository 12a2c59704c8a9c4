"""Strict reading of a YAML file that a person wrote, with the place of every part.

Features that could give a file an unintended meaning are refused: duplicate keys, anchors and
aliases, merge keys, tags, a second document. All else follows the rules of YAML 1.2. Size and depth
of a file are bounded, so that a hostile file is only an error.
"""

import re
from pathlib import Path
from typing import Any, Final

import yaml

from piezod.config.document import Document, KeyPath, SourcePlace, config_error
from piezod.config.scalars import Scalar, resolve
from piezod.config.yaml_events import parse_events, read_text, start_of
from piezod.errors import ConfigError, Problem

MAX_DEPTH: Final = 20
"""Deeper than any configuration, and far from the recursion limit of Python."""

_SURROGATE: Final = re.compile("[\ud800-\udfff]")


def load_yaml(path: Path) -> Document:
    """Return the document of a file whose top level is a mapping.

    Raises:
        ConfigError: If the file cannot be read or is not such a document; it lists all problems
            found.
    """
    return parse_yaml(read_text(path), str(path))


def parse_yaml(text: str, file: str) -> Document:
    """Return the document of a text whose top level is a mapping.

    Raises:
        ConfigError: As `load_yaml`.
    """
    builder = _Builder(text, file)
    try:
        data = builder.build()
    except ConfigError as error:
        raise config_error((*builder.problems, *error.problems)) from error
    if builder.problems:
        raise config_error(builder.problems)
    return Document(file, data, builder.values, builder.keys)


class _Builder:
    """Converts the events of a text into plain data, and collects the problems."""

    def __init__(self, text: str, file: str) -> None:
        self.problems: list[Problem] = []
        self.values: dict[KeyPath, SourcePlace] = {}
        self.keys: dict[KeyPath, SourcePlace] = {}
        self._file = file
        self._events = parse_events(text, file)

    def build(self) -> dict[str, Any]:
        """Return the top level of the single document.

        Raises:
            ConfigError: If building cannot continue; `problems` holds the earlier problems.
        """
        data: Any = None
        # All events, also those after the document: an error at the end of the text counts too.
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if self.values:
                    raise self._error(event, "a second document starts, allowed: one in a file")
                data = self._node(next(self._events), ())
        if not self.values:
            raise ConfigError(Problem(self._file, 1, 1, "", "the file is empty"))
        if not isinstance(data, dict):
            what = "the top level must be a mapping, lines of `key: value`"
            raise ConfigError(Problem(self._file, *self.values[()], "", what))
        return data

    def _node(self, event: yaml.Event, path: KeyPath) -> object:
        self.values[path] = start_of(event)
        if isinstance(event, yaml.AliasEvent):
            self._add(event, f"alias *{event.anchor} is not allowed, write the value out")
            return None
        self._refuse_decoration(event)
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event)
        if len(path) >= MAX_DEPTH:
            raise self._error(event, f"nested too deeply, allowed: {MAX_DEPTH} levels")
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(path)
        return self._mapping(path)

    def _sequence(self, path: KeyPath) -> tuple[object, ...]:
        items: list[object] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._node(event, (*path, len(items))))
        return tuple(items)

    def _mapping(self, path: KeyPath) -> dict[str, object]:
        mapping: dict[str, object] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key = self._key(event)
            if key in mapping:
                first = self.keys[*path, key].line
                self._add(event, f"duplicate key {key!r}, first in line {first}")
            else:
                self.keys[*path, key] = start_of(event)
            mapping[key] = self._node(next(self._events), (*path, key))
        return mapping

    def _key(self, event: yaml.Event) -> str:
        if not isinstance(event, yaml.ScalarEvent):
            raise self._error(event, "a key must be a text")
        self._refuse_decoration(event)
        if event.value == "<<" and event.implicit[0]:
            self._add(event, "merge key << is not allowed, write the keys out")
        elif not isinstance(self._scalar(event), str):
            self._add(event, f"a key must be a text (got {event.value}), put it in quotes")
        return str(event.value)

    def _scalar(self, event: yaml.ScalarEvent) -> Scalar:
        if _SURROGATE.search(event.value):
            self._add(event, "half of a surrogate pair is not a character")
        if not event.implicit[0]:  # in quotes, hence a text
            return str(event.value)
        try:
            return resolve(event.value)
        except ValueError as error:
            self._add(event, str(error))
            return None  # the reading goes on, to find further problems

    def _refuse_decoration(self, event: yaml.Event) -> None:
        anchor, tag = getattr(event, "anchor", None), getattr(event, "tag", None)
        if anchor is not None:
            self._add(event, f"anchor &{anchor} is not allowed")
        if tag is not None:
            tag = tag.replace("tag:yaml.org,2002:", "!!")
            self._add(event, f"tag {tag} is not allowed, the type follows from the value")

    def _add(self, event: yaml.Event, what: str) -> None:
        self.problems.append(Problem(self._file, *start_of(event), "", what))

    def _error(self, event: yaml.Event, what: str) -> ConfigError:
        return ConfigError(Problem(self._file, *start_of(event), "", what))
