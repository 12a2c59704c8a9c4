"""Tests of the pty end of an emulator."""

import os
from contextlib import suppress
from pathlib import Path

from piezod.devices.emulation.pty_end import PtyEnd
from tests.daemon.waiting import eventually


def test_a_long_reply_comes_whole_over_a_pty(tmp_path: Path) -> None:
    """The rest of it follows when the kernel has room again."""
    end, long = PtyEnd(tmp_path / "long.tty"), bytes(range(256)) * 200
    end.appear()
    client = os.open(tmp_path / "long.tty", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        end.send(long)
        got = b""

        def is_whole() -> bool:
            nonlocal got
            end.receive(0)
            with suppress(BlockingIOError):
                got += os.read(client, 65_536)
            return len(got) >= len(long)

        eventually(is_whole)
        assert got == long
    finally:
        os.close(client)
        end.vanish()
