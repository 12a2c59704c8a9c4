"""The table of commands for the HTTP service: rows by method and path, and routes of rows."""

from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from typing import Any, Final

from fastapi import APIRouter
from starlette.routing import compile_path

from piezod.daemon.service.answers import JsonAnswer
from piezod.messages.answers import ErrorDocument
from piezod.messages.endpoints import Endpoint
from piezod.messages.requests import TABLE

PREFIX: Final = "/v1"
ROUTES: Final[Mapping[tuple[str, str], Endpoint]] = {
    (row.method, f"{PREFIX}/{row.path}"): row for row in TABLE.values()
}
"""Every endpoint by method and path; the application has no others."""
URGENT: Final = frozenset(route for route, row in ROUTES.items() if row.access.urgent)
"""The endpoints that are served at any rate and on any connection."""
_ERRORS: Final[dict[int | str, dict[str, Any]]] = {"default": {"model": ErrorDocument}}


_PATTERNS: Final = [(compile_path(path)[0], method) for method, path in ROUTES]


def methods_of(path: str) -> list[str]:
    """Return the methods of the endpoints with a path, sorted."""
    literal = {method for method, template in ROUTES if template == path}
    # Only then: a template such as `recordings/{name}` fits the paths of other endpoints too.
    fitting = {method for pattern, method in _PATTERNS if pattern.fullmatch(path)}
    return sorted(literal or fitting)


def endpoint(
    router: APIRouter, name: str, /, **options: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds a function to a router as the endpoint of a row.

    Args:
        router: The router.
        name: Name of the row in the table of commands.
        options: Further arguments of `APIRouter.api_route`.
    """
    row = TABLE[name]
    settings = {
        "responses": _responses(row),
        "response_model": None,
        "response_class": JsonAnswer,
        "description": row.help,
        **options,
    }
    return router.api_route(f"/{row.path}", methods=[row.method], **settings)


def _responses(row: Endpoint) -> dict[int | str, dict[str, Any]]:
    answer = row.answer_class
    if answer is None or not is_dataclass(answer) or row.name == "telemetry":
        return _ERRORS
    fine: dict[int | str, dict[str, Any]] = {200: {"model": answer}}
    if row.also_fine != 200:
        fine[row.also_fine] = {"model": answer, "description": row.help}
    return {**fine, **_ERRORS}
