"""The two clients are one."""

from tests.blocking_client import MADE, blocking_client


def test_blocking_client_is_made_from_the_one_for_asyncio() -> None:
    """The file has what `python -m tests.blocking_client` writes."""
    assert MADE.read_text(encoding="utf-8") == blocking_client()
