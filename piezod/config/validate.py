"""Validation of a document against a model, with the place of every error in the file."""

from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from piezod.config.document import Document, KeyPath, config_error
from piezod.config.fields import Context
from piezod.config.messages import describe
from piezod.errors import Problem

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

ModelT = TypeVar("ModelT", bound=BaseModel)


def validate(document: Document, model: type[ModelT], context: Context) -> ModelT:
    """Return a model made from a document.

    Raises:
        ConfigError: If the document violates the schema or a rule; it lists every problem.
    """
    try:
        return model.model_validate(document.data, context=context)
    except ValidationError as failure:
        errors = failure.errors()
        problems = [
            _place(document, error, context)
            for error in errors
            if not _is_consequence(error, errors)
        ]
        raise config_error(problems) from failure


def _is_consequence(error: "ErrorDetails", errors: "list[ErrorDetails]") -> bool:
    """Return whether a list is too short only because pydantic leaves out its invalid entries."""
    loc = error["loc"]
    return error["type"] == "too_short" and any(
        other is not error and other["loc"][: len(loc)] == loc for other in errors
    )


def _place(document: Document, error: "ErrorDetails", context: Context) -> Problem:
    kind, loc = error["type"], error["loc"]
    if kind in ("missing", "extra_forbidden"):
        # The last part is the key itself: absent if it is missing, and not in the model if extra.
        path, owner = _find(document.data, loc[:-1])
        path = (*path, loc[-1])
        what = describe(error, context.known_keys.get(id(owner), ()))
        return document.problem(path, what, at_key=True)
    path, found = _find(document.data, loc)
    if kind == "union_tag_invalid":  # the place of the tag, not of the whole mapping
        path = (*path, error["ctx"]["discriminator"].strip("'"))
        return document.problem(path, describe(error, ()))
    # An error of a whole mapping is reported at its key. pydantic ends the path with "[key]" if
    # the key itself is invalid.
    at_key = isinstance(found, dict) or loc[-1:] == ("[key]",)
    return document.problem(path, describe(error, ()), at_key=at_key)


def _find(data: object, loc: tuple[int | str, ...]) -> tuple[KeyPath, object]:
    """Follow pydantic's path as far as it exists in the file.

    The path also contains members of unions, which are not in the file and are left out.
    """
    path: KeyPath = ()
    node: Any = data
    for part in loc:
        if _has(node, part):
            path = (*path, part)
            node = node[part]
    return path, node


def _has(node: object, part: int | str) -> bool:
    if isinstance(node, tuple):
        return isinstance(part, int) and part < len(node)
    return isinstance(node, dict) and part in node
