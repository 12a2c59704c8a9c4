"""The OpenAPI description: that of FastAPI, made as strict as the daemon is."""

import inspect
from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import Any, Final

import pydantic.dataclasses  # noqa: F401 - the first document needs it; an upgrade may come before
from fastapi import FastAPI

from piezod.messages import answers, stores
from piezod.messages.documents import Document, attributes

_REFUSED: Final = ("Csv",)
"""Waveforms that files may have and requests may not: the daemon reads no files of clients."""
_JSON: Final = "application/json"
_ANSWERS: Final = {
    name: each
    for module in (answers, stores)
    for name, each in vars(module).items()
    if is_dataclass(each) and isinstance(each, type)
}
"""Classes of answers and of their parts."""


class DescribedApp(FastAPI):
    """An application whose description allows nothing that the daemon refuses by its form."""

    def openapi(self) -> Document:
        """Return the description, which is made once."""
        if self.openapi_schema is None:
            _tighten(super().openapi())
        return super().openapi()


def _tighten(document: Document) -> None:
    """Change a description in place."""
    schemas = document["components"]["schemas"]
    for name in _REFUSED:
        schemas.pop(name, None)
    for name in schemas.keys() & _ANSWERS.keys():
        _describe(schemas[name], _ANSWERS[name])
    for part in _mappings(document):
        if "patternProperties" in part:  # names of axes: no others
            part.setdefault("additionalProperties", False)
        if "oneOf" in part:
            part["oneOf"] = [each for each in part["oneOf"] if not _is_refused(each.get("$ref"))]
            mapping = part.get("discriminator", {}).get("mapping", {})
            for kind in [kind for kind, target in mapping.items() if _is_refused(target)]:
                del mapping[kind]
    for path in document["paths"].values():
        for operation in path.values():
            _tighten_operation(operation, schemas)


def _describe(schema: Document, answer: type) -> None:
    """Give an answer and its fields the words of its class, in place."""
    schema["description"] = inspect.cleandoc(answer.__doc__ or "")
    for name, text in attributes(answer).items():
        schema["properties"][name]["description"] = text


def _tighten_operation(operation: Document, schemas: Document) -> None:
    """Make errors JSON whatever the answer is, and a body optional that may be empty."""
    if errors := operation["responses"].get("default"):
        errors["content"] = {_JSON: next(iter(errors["content"].values()))}
    body = operation.get("requestBody", {"content": {}})
    if _JSON in body["content"]:
        body["required"] = _requires_keys(body["content"][_JSON]["schema"], schemas)


def _mappings(value: Any) -> Iterator[Document]:
    if isinstance(value, dict):
        yield value
    for entry in value.values() if isinstance(value, dict) else value:
        if isinstance(entry, dict | list):
            yield from _mappings(entry)


def _is_refused(reference: str | None) -> bool:
    return (reference or "").rpartition("/")[2] in _REFUSED


def _requires_keys(schema: Document, schemas: Document) -> bool:
    """Return whether an object has required keys; an empty body means an empty object."""
    name = schema.get("$ref", "").rpartition("/")[2]
    return bool(schemas.get(name, schema).get("required"))
