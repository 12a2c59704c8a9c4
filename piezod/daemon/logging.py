"""The log on stderr: lines for people on a terminal, JSON with a priority for the journal."""

import logging
import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, Final, Protocol, TextIO, TypeAlias, cast

from piezod.daemon.lean_structlog import structlog
from piezod.units import NS_PER_S

EventDict: TypeAlias = structlog.typing.EventDict
Processor: TypeAlias = structlog.typing.Processor
WrappedLogger: TypeAlias = structlog.typing.WrappedLogger

MAX_LINES, WINDOW_S = 10, 10.0
# The priorities of the journal, see syslog(3); "critical" and "exception" do not occur.
_PRIORITIES: Final = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}


class EventRateLimit:
    """Lets ten lines of a kind pass in ten seconds, and counts the others.

    The first line after that has the number of dropped ones. A kind is an event with its fault id;
    there are few of them.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._kinds: dict[tuple[str, str], tuple[float, int]] = {}

    @property
    def drops(self) -> bool:
        """Whether lines of a kind are dropped now."""
        now_s = self._now_s()
        return any(
            count > MAX_LINES and now_s - begun_s < WINDOW_S
            for begun_s, count in self._kinds.values()
        )

    def __call__(self, _logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
        """Return the event, or drop it."""
        kind = (str(event.get("event")), str(event.get("fault", "")))
        now_s = self._now_s()
        begun_s, count = self._kinds.get(kind, (now_s, 0))
        if now_s - begun_s >= WINDOW_S:
            if count > MAX_LINES:
                event["suppressed"] = count - MAX_LINES
            begun_s, count = now_s, 0
        self._kinds[kind] = (begun_s, count + 1)
        if count >= MAX_LINES:
            raise structlog.DropEvent
        return event


class LogStream(Protocol):
    """What the log needs of a stream."""

    def write(self, text: str, /) -> int:
        """Write a text."""
        ...

    def flush(self) -> None:
        """Bring written texts to their reader."""
        ...

    def fileno(self) -> int:
        """Return the file descriptor."""
        ...

    def isatty(self) -> bool:
        """Return whether the reader is a terminal."""
        ...


def set_up_logging(
    stream: LogStream | None = None, environ: Mapping[str, str] = os.environ
) -> None:
    """Send the log of this process to a stream, in the form for its reader.

    Warnings and errors of libraries go there too.

    Args:
        stream: The stream; stderr by default.
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
        # The limit first, because a dropped line should cost nothing more.
        processors=[EventRateLimit(), *shared, *last],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.WriteLoggerFactory(cast("TextIO", stream)),
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


def drops_lines() -> bool:
    """Return whether the log drops lines of a kind now, because there are too many."""
    steps = structlog.get_config()["processors"]
    return any(step.drops for step in steps if isinstance(step, EventRateLimit))


def logger(room: str) -> Any:
    """Return the logger of a part of the daemon, as in `logger("supervisor").info("ready")`."""
    return structlog.get_logger(room=room)


def _is_journal(stream: LogStream, environ: Mapping[str, str]) -> bool:
    """Return whether a stream leads to the journal, which systemd names by device and inode."""
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


def _for_people(stream: LogStream) -> list[Processor]:
    return [
        _for_readers,
        structlog.dev.ConsoleRenderer(
            colors=stream.isatty(),
            pad_event_to=0,
            exception_formatter=structlog.dev.plain_traceback,
        ),
    ]


def _for_journal() -> list[Processor]:
    return [
        _with_instant,
        structlog.processors.format_exc_info,
        structlog.processors.JSONRenderer(sort_keys=True),
        _with_priority,
    ]


def _with_priority(_logger: WrappedLogger, level: str, line: Any) -> str:
    # systemd reads the priority from the beginning of each line.
    return f"<{_PRIORITIES.get(level, 6)}>{line}"


def _finite(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Remove numbers that are not finite: JSON has none, and they have no meaning here."""
    return {
        key: value
        for key, value in event.items()
        if not (isinstance(value, float) and not math.isfinite(value))
    }


def _for_readers(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Put time and text of an event first, and remove fields that only programs need."""
    if text := event.pop("text", ""):
        event["event"] = f"{event['event']}: {text}"
    event["timestamp"] = _local_time(event.pop("t_ns", None)).strftime("%H:%M:%S.%f")
    event.pop("room", None)
    return event


def _with_instant(_logger: WrappedLogger, _level: str, event: EventDict) -> EventDict:
    """Add the instant of an event that is logged later; the journal knows that of other lines."""
    if "t_ns" in event:
        event["at"] = _local_time(event["t_ns"]).isoformat()
    return event


def _local_time(t_ns: int | None) -> datetime:
    """Convert an instant of the monotonic clock to local time; None is the present."""
    # By way of the age, because the monotonic clock has no date.
    age_ns = 0 if t_ns is None else time.monotonic_ns() - t_ns
    return datetime.fromtimestamp((time.time_ns() - age_ns) / NS_PER_S).astimezone()
