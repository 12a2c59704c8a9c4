"""The base of all messages of a page."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class MessagePart(BaseModel):
    """A part of a message; it has no unknown key."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Message(MessagePart):
    """A message: it has a number for the answer."""

    id: Annotated[int, Field(ge=0, lt=2**53)]
