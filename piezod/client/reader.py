"""Makes typed results from documents, and checks them."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeVar

from piezod.client.errors import unexpected
from piezod.messages.answers import Document, Result

if TYPE_CHECKING:
    from pydantic import TypeAdapter

ResultT = TypeVar("ResultT", bound=Result)


def reader(result: type[ResultT]) -> Callable[[Document], ResultT]:
    """Return a function that makes a result from a document.

    The function raises ClientError if the document does not fit.
    """

    def read(document: Document) -> ResultT:
        from pydantic import ValidationError

        try:
            made: ResultT = _adapter(result).validate_python({**document, "document": document})
        except ValidationError as error:
            raise unexpected(document, str(error)) from error
        return made

    return read


def _adapter(result: type[Result]) -> "TypeAdapter[Any]":
    """Return the adapter of a result, made at first use: pydantic takes long to import."""
    if result not in _ADAPTERS:
        from pydantic import TypeAdapter

        _ADAPTERS[result] = TypeAdapter(result)
    return _ADAPTERS[result]


_ADAPTERS: "Final[dict[type[Result], TypeAdapter[Any]]]" = {}
