"""Reads answers from documents, and checks them."""

from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from piezod.client.errors import unexpected
from piezod.messages.documents import Message

if TYPE_CHECKING:
    from pydantic import TypeAdapter

MessageT = TypeVar("MessageT", bound=Message)


def read(answer: type[MessageT], document: Any) -> MessageT:
    """Return the answer that a document is; it keeps the document.

    Raises:
        ClientError: If the document does not fit.
    """
    from pydantic import ValidationError

    kind: Any = answer
    try:
        made: MessageT = _adapter(kind).validate_python(document)
    except ValidationError as error:
        raise unexpected(document, str(error)) from error
    vars(made)["document"] = document
    return made


@cache
def _adapter(answer: type[Message]) -> "TypeAdapter[Any]":
    """Return the adapter of an answer, made at first use: pydantic takes long to import."""
    from pydantic import TypeAdapter

    return TypeAdapter(answer)
