"""The log: lines for people on a terminal, JSON with a priority for the journal; to stderr."""

import logging
import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, Final, TextIO

import structlog
from structlog.typing import EventDict, Processor, WrappedLogger

from piezod.units import NS_PER_S

MOST, WITHIN_S = 10, 10.0
# What the journal calls them (syslog(3)); "critical" and "exception" do not occur.
_PRIORITIES: Final = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}


class EventRateLimit:
    """Lets ten lines of a kind through in ten seconds and counts the others.

    The first line of a kind after that tells how many were left out. Kinds are event and
    fault id, of which there are few.

    Args:
        now_s: The clock, in s.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._kinds: dict[tuple[str, str], tuple[float, int]] = {}

    def __call__(self, _logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
        """Return the event, or drop it."""
        kind = (str(event.get("event")), str(event.get("fault", "")))
        now_s = self._now_s()
        begun_s, count = self._kinds.get(kind, (now_s, 0))
        if now_s - begun_s >= WITHIN_S:
            if count > MOST:
                event["suppressed"] = count - MOST
            begun_s, count = now_s, 0
        self._kinds[kind] = (begun_s, count + 1)
        if count >= MOST:
            raise structlog.DropEvent
        return event


def set_up_logging(stream: TextIO | None = None, environ: Mapping[str, str] = os.environ) -> None:
    """Send the log of this process to a stream, in the form that its reader wants.

    The libraries' own loggers end up there too, from warnings on.

    Args:
        stream: Where to; left out: stderr.
        environ: The environment variables.
    """
    stream = stream or sys.stderr
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        _finite,
    ]
    last = _for_journal() if _is_journal(stream, environ) else _for_people(stream)
    structlog.configure(
        processors=[EventRateLimit(), *shared, *last],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.WriteLoggerFactory(stream),
        cache_logger_on_first_use=False,
    )
    handler = logging.StreamHandler(stream)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last],
        )
    )
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)


def logger(room: str) -> Any:
    """Return the logger of a part of the daemon, as in `logger("supervisor").info("ready")`."""
    return structlog.get_logger(room=room)


def _is_journal(stream: TextIO, environ: Mapping[str, str]) -> bool:
    """Tell whether a stream leads to the journal, which is what systemd names by its inode."""
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


def _for_people(stream: TextIO) -> list[Processor]:
    return [
        _shortened,
        structlog.dev.ConsoleRenderer(
            colors=stream.isatty(),
            pad_event_to=0,
            exception_formatter=structlog.dev.plain_traceback,
        ),
    ]


def _for_journal() -> list[Processor]:
    return [
        _dated,
        structlog.processors.format_exc_info,
        structlog.processors.JSONRenderer(sort_keys=True),
        _with_priority,
    ]


def _with_priority(_logger: WrappedLogger, level: str, line: Any) -> str:
    return f"<{_PRIORITIES.get(level, 6)}>{line}"


def _finite(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Leave out numbers that say nothing and that JSON does not have."""
    return {
        key: value
        for key, value in event.items()
        if not (isinstance(value, float) and not math.isfinite(value))
    }


def _shortened(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Put time and text of an event first, and leave out what only programs read."""
    if text := event.pop("text", ""):
        event["event"] = f"{event['event']}: {text}"
    event["timestamp"] = _when(event.pop("t_ns", None)).strftime("%H:%M:%S.%f")
    event.pop("room", None)
    return event


def _dated(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Tell when an event was that is logged only now; of others the journal knows it."""
    if "t_ns" in event:
        event["at"] = _when(event["t_ns"]).isoformat()
    return event


def _when(t_ns: int | None) -> datetime:
    """Convert an instant of the monotonic clock to local time; None is the present."""
    age_ns = 0 if t_ns is None else time.monotonic_ns() - t_ns
    return datetime.fromtimestamp((time.time_ns() - age_ns) / NS_PER_S).astimezone()
