"""docs/client.md: its examples run, and it is complete."""

import re
from pathlib import Path

import pytest

from piezod.client import StageClient
from tests.client.fake_daemon import FakeDaemon, interval
from tests.command_table import page

PAGE = (Path(__file__).parents[2] / "docs" / "client.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"(?<!-->\n)```python\n(.*?)```", PAGE, flags=re.DOTALL)
"""Without the long ones, which have a comment before them: these run with all pages."""


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_examples_run(daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, example: str) -> None:
    """Each example of the page runs."""
    monkeypatch.setenv("PIEZOD_SOCKET", str(daemon.socket_path))
    monkeypatch.setattr("time.sleep", lambda _: None)
    daemon.answers["POST stream"] = {"accepted": True, "setpoints": 100}
    daemon.telemetry = [interval(on_target=True)] * 10

    exec(compile(example, "client.md", "exec"), {"__name__": "example"})  # noqa: S102 - our own page

    assert daemon.asked


def test_all_methods_are_named() -> None:
    """The page names every method of the client."""
    methods = [name for name in dir(StageClient) if name[0] != "_"]

    assert [name for name in methods if f"`{name}" not in PAGE] == ["call", "close"]


def test_tables_are_up_to_date() -> None:
    """If this fails, `python -m tests.command_table` writes both tables anew."""
    assert page() == PAGE
