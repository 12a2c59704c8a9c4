"""The application: all endpoints behind the gate, described by OpenAPI, on a unix socket."""

import asyncio
import inspect
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

import pydantic.dataclasses
import pydantic.root_model  # noqa: F401 - the first document needs both; an upgrade may come before
import uvicorn
from fastapi import FastAPI

from piezod import __version__
from piezod.daemon.service.access import LeaseKeeper, RateLimit, Roles, UrgentNotes
from piezod.daemon.service.answers import add_error_answers
from piezod.daemon.service.connection import ConnectionLimits, PeerProtocol
from piezod.daemon.service.gate import Gate
from piezod.daemon.service.request import OpenStreams, ServiceState
from piezod.daemon.service.route import methods_of
from piezod.daemon.service.routes import router
from piezod.daemon.stage.running_stage import RunningStage
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


def create_app(
    stage: RunningStage, roles: Roles, now_s: Callable[[], float] = time.monotonic
) -> FastAPI:
    """Return the application of a stage.

    Args:
        stage: The stage.
        roles: Gives the role of each user; `roles.GroupRoles`.
        now_s: Monotonic clock, in s.
    """
    app = DescribedApp(
        title="piezod", version=__version__, openapi_url=None, docs_url=None, redoc_url=None
    )
    notes, streams = UrgentNotes(now_s), OpenStreams()
    app.state.service = ServiceState(stage, roles, LeaseKeeper(now_s), set(), notes, streams, {})
    app.state.methods_of = methods_of
    app.state.reading = asyncio.Semaphore(1)
    app.add_middleware(Gate, rate_limit=RateLimit(now_s))
    add_error_answers(app)
    app.include_router(router)
    return app


_MAX_HEADER: Final = 64 * 1024
_BACKLOG: Final = 128
"""Connections that wait to be accepted; asyncio accepts so many at once, and without descriptors it
fails as many times."""
_NOT_OTHERS: Final = 0o117  # user and group may use the socket; its folder sets the group


class SupervisedServer(uvicorn.Server):
    """A server that leaves signals to the supervisor, and ends when `should_exit` is set."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield

    async def listen(self, endpoint: socket.socket) -> None:
        """Accept connections on a further socket, from `bind`, as on those of `serve`."""

        def protocol() -> "asyncio.Protocol":
            state = self.server_state, self.lifespan.state
            make = cast("Callable[..., asyncio.Protocol]", self.config.http_protocol_class)
            return make(config=self.config, server_state=state[0], app_state=state[1])

        loop = asyncio.get_running_loop()
        self.servers.append(
            await loop.create_unix_server(protocol, sock=endpoint, backlog=self.config.backlog)
        )


def make_server(app: FastAPI, limits: ConnectionLimits) -> SupervisedServer:
    """Return a server; `await server.serve(sockets=[bind(path)])` runs it."""
    protocol = partial(PeerProtocol, limits=limits)
    config = uvicorn.Config(
        app,
        # uvicorn only calls it, so a partial will do.
        http=cast("type[asyncio.Protocol]", protocol),
        ws="none",
        lifespan="off",
        loop="asyncio",
        log_config=None,
        log_level="error",  # warnings are about clients, which could fill the log
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_MAX_HEADER,
        backlog=_BACKLOG,
        timeout_keep_alive=limits.idle_s,
        timeout_graceful_shutdown=5,
    )
    return SupervisedServer(config)


def bind(path: Path) -> socket.socket:
    """Bind the socket for its user and group; replace a socket that a dead daemon left.

    Call it only while holding the lock of the daemon: no other daemon uses the path then.

    Raises:
        OSError: If the path cannot be bound.
    """
    path.unlink(missing_ok=True)
    endpoint = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(_NOT_OTHERS)
    try:
        endpoint.bind(str(path))
    except OSError:
        endpoint.close()
        raise
    finally:
        os.umask(before)
    return endpoint
