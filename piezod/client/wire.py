"""What both clients do with a call before and after it is on the wire."""

import functools
import inspect
import uuid
from collections.abc import Callable
from typing import Any, Final, TypeVar, get_args

import httpx

from piezod.client.calls import Call
from piezod.client.errors import error_of, unexpected

BASE_URL: Final = "http://piezod/v1/"
"""The host's name means nothing on a unix socket."""
TIMEOUT: Final = httpx.Timeout(10.0, connect=2.0)

ResultT = TypeVar("ResultT")
FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def new_name() -> str:
    """Return a name for a client that no other client has."""
    return f"python-{uuid.uuid4().hex[:12]}"


def headers(name: str) -> dict[str, str]:
    """Return what every request of a client carries."""
    return {"X-Piezod-Client": name}


def read_answer(call: Call[ResultT], response: httpx.Response) -> ResultT:
    """Return the result that an answer, read to its end, holds.

    Raises:
        ClientError: If it is an error, or nothing that the call could lead to.
    """
    check(response)
    try:
        document = response.json()
    except ValueError as error:
        raise unexpected(response.content, str(error)) from error
    if not isinstance(document, dict):
        raise unexpected(document, "must be an object")
    return call.read(document)


def check(response: httpx.Response) -> None:
    """Raise the error that an answer, read to its end, tells, if it does.

    Raises:
        ClientError: If so.
    """
    if response.is_error:
        raise error_of(response.status_code, response.content)


def as_method(method: FunctionT, make: Callable[..., Call[Any]]) -> FunctionT:
    """Give the method of a client the name, text and signature of the call that it carries out."""
    functools.update_wrapper(method, make)
    signature = inspect.signature(make)
    this = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    (result,) = get_args(signature.return_annotation)
    signature = signature.replace(
        parameters=(this, *signature.parameters.values()), return_annotation=result
    )
    vars(method)["__signature__"] = signature
    return method
