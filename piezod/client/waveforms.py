"""Waveforms as they are sent: with points in place of files, which a daemon does not read."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from piezod.config.waveforms import Csv


def sendable(value: object) -> object:
    """Return waveforms, or anything they are made of, as plain data with points in place of files.

    Args:
        value: Models, mappings, lists and plain values, nested in any way.

    Raises:
        ValidationError: If a file named in it cannot be read.
    """
    if isinstance(value, Csv):
        return {"kind": "points", "points": value.points}
    if isinstance(value, BaseModel):
        return {name: sendable(getattr(value, name)) for name in type(value).model_fields}
    if isinstance(value, Mapping):
        return _sendable_mapping(value)
    if isinstance(value, list | tuple):
        return tuple(map(sendable, value))
    return value


def _sendable_mapping(value: Mapping[str, Any]) -> object:
    if value.get("kind") == "csv":
        return sendable(Csv.model_validate(dict(value)))
    return {key: sendable(each) for key, each in value.items()}
