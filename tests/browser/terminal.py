"""The picture of `piezod watch` in a terminal of 80 columns."""

import io
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser
from rich.console import Console, RenderableType

from piezod.cli.look.watch_view import WatchView, ranges_of
from piezod.client import StageClient

COLUMNS: Final = 80
RATE_HZ: Final = 10.0
N_INTERVALS: Final = 310
"""Enough to fill the sparklines."""


def picture_of_watch(browser: Browser, socket: Path) -> bytes:
    """Return what `piezod watch` shows of a running stage after half a minute, as PNG."""
    shown: RenderableType = ""
    with StageClient(socket=socket) as stage:
        view = WatchView(socket.parent.name, ranges_of(stage.config()))
        intervals = stage.telemetry(RATE_HZ)
        for interval, _ in zip(intervals, range(N_INTERVALS), strict=False):
            shown = view.update(interval, ())
        intervals.close()
    terminal = Console(
        record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, legacy_windows=False
    )
    terminal.print(shown)
    page = browser.new_page(viewport={"width": 1000, "height": 600})
    page.set_content(terminal.export_svg(title="piezod watch"))
    png: bytes = page.locator("svg.rich-terminal").screenshot()
    return png
