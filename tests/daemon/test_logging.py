"""The log, for the journal and for people."""

import io
import json
import logging
import math
import os
import time
import warnings
from datetime import datetime, timedelta
from pathlib import Path

import pytest
import structlog

from piezod.daemon.logging import MAX_LINES, WINDOW_S, EventRateLimit, logger, set_up_logging
from piezod.units import NS_PER_S


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """Return a file that the log takes for the journal."""
    path = tmp_path / "journal"
    with path.open("w", encoding="utf-8") as stream:
        found = os.fstat(stream.fileno())
        set_up_logging(stream, {"JOURNAL_STREAM": f"{found.st_dev}:{found.st_ino}"})
        logger("loop").error("fault", fault="S5", measured=3.5, limit=math.nan)
        logger("supervisor").info("ready")
        logging.getLogger("some.library").warning("odd %s", "thing")
    return path


def test_journal_gets_priority_and_json(journal: Path) -> None:
    """Each line begins with the priority for systemd, also lines of libraries."""
    lines = journal.read_text(encoding="utf-8").splitlines()

    assert [line[:3] for line in lines] == ["<3>", "<6>", "<4>"]
    assert [json.loads(line[3:])["event"] for line in lines] == ["fault", "ready", "odd thing"]


def test_journal_gets_no_number_that_json_does_not_have(journal: Path) -> None:
    """A number that is not finite is left out."""
    first = json.loads(journal.read_text(encoding="utf-8").splitlines()[0][3:])

    assert first["measured"] == 3.5
    assert "limit" not in first


def test_people_get_plain_lines() -> None:
    """Any other stream gets no JSON, and the text of exceptions."""
    stream = io.StringIO()
    set_up_logging(stream, {"JOURNAL_STREAM": "1:2"})

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            int("out of luck")
        except ValueError:
            logger("supervisor").exception("loop gone", code=-9)

    text = stream.getvalue()
    assert "loop gone" in text
    assert "code=-9" in text
    assert "out of luck" in text
    assert "{" not in text


@pytest.mark.fault("P15")
def test_flood_is_cut_and_counted() -> None:
    """Ten lines of a kind pass in ten seconds; the next one has the number of dropped lines."""
    now_s = 0.0
    limit = EventRateLimit(lambda: now_s)
    kept = 0
    for _ in range(100_000):
        try:
            limit(None, "warning", {"event": "fault", "fault": "S4"})
            kept += 1
        except structlog.DropEvent:
            pass

    now_s = WINDOW_S
    after = limit(None, "warning", {"event": "fault", "fault": "S4"})

    assert kept == MAX_LINES
    assert after["suppressed"] == 100_000 - MAX_LINES


def test_flood_of_one_fault_hides_no_other() -> None:
    """Each kind has its own limit."""
    limit = EventRateLimit(lambda: 0.0)
    for _ in range(MAX_LINES):
        limit(None, "warning", {"event": "fault", "fault": "S4"})

    assert limit(None, "error", {"event": "fault", "fault": "A1"})["fault"] == "A1"


def test_journal_gets_the_instant_of_an_event(tmp_path: Path) -> None:
    """An event that is logged later has its own instant, with the offset from UTC."""
    path = tmp_path / "journal"
    with path.open("w", encoding="utf-8") as stream:
        found = os.fstat(stream.fileno())
        set_up_logging(stream, {"JOURNAL_STREAM": f"{found.st_dev}:{found.st_ino}"})
        before = datetime.now().astimezone()
        logger("loop").error("fault", t_ns=time.monotonic_ns() - 60 * NS_PER_S)
    line = json.loads(path.read_text(encoding="utf-8")[3:])

    age = before - datetime.fromisoformat(line["at"])
    assert timedelta(seconds=50) < age < timedelta(seconds=60, milliseconds=1)
