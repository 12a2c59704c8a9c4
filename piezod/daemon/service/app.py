"""The application: all endpoints behind the gate."""

import asyncio
import time
from collections.abc import Callable

from fastapi import FastAPI

from piezod import __version__
from piezod.daemon.service import routes_commands, routes_look, routes_stores
from piezod.daemon.service.answers import add_error_answers
from piezod.daemon.service.gate import Gate
from piezod.daemon.service.lease import Lease
from piezod.daemon.service.open_streams import OpenStreams
from piezod.daemon.service.openapi import DescribedApp
from piezod.daemon.service.rate_limit import RateLimit
from piezod.daemon.service.request_context import ServiceState
from piezod.daemon.service.roles import Roles
from piezod.daemon.service.route_table import methods_of
from piezod.daemon.service.urgent_notes import UrgentNotes
from piezod.daemon.stage.running_stage import RunningStage


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
    app.state.service = ServiceState(stage, roles, Lease(now_s), set(), notes, streams, {})
    app.state.methods_of = methods_of
    app.state.reading = asyncio.Semaphore(1)
    app.add_middleware(Gate, rate_limit=RateLimit(now_s))
    add_error_answers(app)
    for routes in (routes_look, routes_commands, routes_stores):
        app.include_router(routes.router)
    return app
