"""How often three tabs draw: `build/browser/bin/python -m benchmarks.page_frames`.

A simulated stage follows a sine at 1 kHz. Three tabs of 1920 by 1080 pixels show it in a chromium
without a window, and all are seen. Prints for each tab how many pictures of its charts a second
has, how many frames the browser made, and the share of the time in which the page itself ran;
beside them the frames of an empty page, before and after, which tell what this machine allows.
Telemetry has 30 rows per second, and no more pictures are drawn.
"""

import argparse
import shutil
from contextlib import ExitStack
from typing import Final

from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.bench_page import TABS, started
from benchmarks.page_and_recording import SINE
from piezod.client import StageClient

SIZE: Final = {"width": 1920, "height": 1080}
SETTLE_MS: Final = 12_000
"""Until the charts are full and the spectrum is drawn."""
COUNTER: Final = """
globalThis.counted = { frames: 0, pictures: 0 };
let drawn = false;
const clear = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...area) {
  drawn = true; // uPlot clears a chart before it draws it
  return clear.apply(this, area);
};
requestAnimationFrame(function frame() {
  counted.frames += 1;
  counted.pictures += drawn;
  drawn = false;
  requestAnimationFrame(frame);
});
"""


def opened(browser: Browser, url: str) -> Page:
    """Return a page in a window of its own, which counts its frames and pictures."""
    page = browser.new_page(viewport=SIZE)
    page.add_init_script(COUNTER)
    page.goto(url)
    return page


def work_s(page: Page) -> float:
    """Return the time for which a page has run, in s."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    found = session.send("Performance.getMetrics")["metrics"]
    session.detach()
    return float(next(each["value"] for each in found if each["name"] == "TaskDuration"))


def measured(pages: dict[str, Page], span_s: float) -> None:
    """Print the rates of pages in a span."""
    begin = {
        name: page.evaluate("[performance.now(), { ...counted }]") for name, page in pages.items()
    }
    worked_s = {name: work_s(page) for name, page in pages.items()}
    next(iter(pages.values())).wait_for_timeout(1000 * span_s)
    for name, page in pages.items():
        now_ms, counts = page.evaluate("[performance.now(), { ...counted }]")
        begin_ms, before = begin[name]
        passed_s = (now_ms - begin_ms) / 1000
        pictures, frames = (
            (counts[key] - before[key]) / passed_s for key in ("pictures", "frames")
        )
        part = (work_s(page) - worked_s[name]) / passed_s
        print(f"{name:12} {pictures:5.1f} pictures/s, {frames:5.1f} frames/s, busy {part:6.1%}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each span")
    span_s = parser.parse_args().seconds
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with ExitStack() as stack, sync_playwright() as playwright:
        _, url = started(stack)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        stage = stack.enter_context(StageClient())
        stage.arm()
        stage.wave({"x": SINE}, duration_s=3600.0)
        empty = opened(browser, "about:blank")
        measured({"empty page": empty}, span_s)
        empty.close()
        tabs = {f"tab {number + 1}": opened(browser, url) for number in range(TABS)}
        tabs["tab 1"].wait_for_timeout(SETTLE_MS)
        measured(tabs, span_s)
        for page in tabs.values():
            page.close()
        measured({"empty page": opened(browser, "about:blank")}, span_s)
        browser.close()


if __name__ == "__main__":
    main()
