"""Files of numbers that a configuration names, and contains once it is loaded."""

from collections.abc import Callable
from pathlib import Path

import yaml
from pydantic import BeforeValidator, ValidationInfo

from piezod.config.fields import ConfigModel, broken_rule, context_of
from piezod.config.files import existing_file
from piezod.errors import ConfigError


def loads(kind: type[ConfigModel], load: Callable[[Path], ConfigModel]) -> BeforeValidator:
    """Return the validator of a key that names such a file.

    A mapping is its contents already: a copy of the configuration contains them.

    Args:
        kind: Model of the contents.
        load: Reads a file.
    """

    def loaded(value: object, info: ValidationInfo) -> object:
        if isinstance(value, dict | kind):
            return value
        try:
            return load(existing_file(value, context_of(info)))
        except ConfigError as error:
            raise broken_rule(str(error.problems[0])) from error  # with file and line

    return BeforeValidator(loaded)


def dump(contents: ConfigModel, title: str, *, exclude_none: bool = False) -> str:
    """Return the text of such a file, with a title for people."""
    document = contents.model_dump(mode="json", exclude_none=exclude_none)
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100)
    return f"# {title}\n{text}"
