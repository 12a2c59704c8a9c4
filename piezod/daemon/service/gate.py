"""The first checks of a request: no foreign web page, and limits of rate and connections."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from piezod.daemon.service.answers import error_answer
from piezod.daemon.service.foreign_pages import refuse_foreign_page
from piezod.daemon.service.peer_protocol import PeerProtocol, connection_of
from piezod.daemon.service.rate_limit import RateLimit
from piezod.daemon.service.refusals import TooManyError
from piezod.daemon.service.route_table import URGENT
from piezod.daemon.stage.errors import StageError

_MALFORMED = (400, 413, 415, 422)


class Gate:
    """Refuses requests of foreign web pages, and limits all others by rate and by connection.

    Requests towards safety have no limits.

    Args:
        app: The application behind the gate.
        rate_limit: Limits the rate of requests.
    """

    def __init__(self, app: ASGIApp, rate_limit: RateLimit) -> None:
        self._app, self._rate_limit = app, rate_limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Admit one request to the application, or refuse it."""
        connection = connection_of(scope)
        try:
            self._admit(scope, connection)
        except StageError as error:
            await error_answer(error)(scope, receive, send)
            return

        async def send_checked(message: Message) -> None:
            if message["type"] == "http.response.start":
                _close_if_needed(message, connection)
            await send(message)

        await self._app(scope, receive, send_checked)

    def _admit(self, scope: Scope, connection: PeerProtocol) -> None:
        process = connection.credentials.uid, connection.credentials.pid
        refuse_foreign_page(scope)
        if (scope["method"], scope["path"]) in URGENT:
            return
        if connection.crowded:
            most = connection.limits.per_user
            what = f"this user has more than {most} connections; the others can only stop the stage"
            raise TooManyError(what, "close some connections")
        if not self._rate_limit.admit(process):
            what = "too many requests, allowed: 50/s for one process and 200/s for all"
            raise TooManyError(
                what,
                "send fewer requests; GET /v1/telemetry and POST /v1/stream are one request each",
            )


def _close_if_needed(start: Message, connection: PeerProtocol) -> None:
    """Close a connection after an answer to an incomplete body, or to the tenth bad request."""
    too_many_bad = start["status"] in _MALFORMED and connection.note_bad_request()
    if too_many_bad or connection.receiving:
        start["headers"] = [*start["headers"], (b"connection", b"close")]
