"""Requests as plain data to send, with points in place of files, which a daemon does not read."""

from collections.abc import Mapping

from pydantic import BaseModel

from piezod.config.waveforms.waveform import WaveformModel


def tupled(value: object) -> object:
    """Return plain data with tuples in place of lists, which strict validation requires."""
    if isinstance(value, Mapping):
        return {key: tupled(each) for key, each in value.items()}
    return tuple(map(tupled, value)) if isinstance(value, list | tuple) else value


def sendable(value: object) -> object:
    """Return a request or a part of it as plain data; a file becomes its points.

    Args:
        value: Models, mappings, tuples and plain values, nested at any depth.

    Raises:
        ValidationError: If a file has more points than may be sent.
    """
    if isinstance(value, WaveformModel):
        value = value.sendable()
    if isinstance(value, BaseModel):
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        return sendable({name: each for name, each in fields.items() if each is not None})
    if isinstance(value, Mapping):
        return {key: sendable(each) for key, each in value.items()}
    return tuple(map(sendable, value)) if isinstance(value, tuple) else value
