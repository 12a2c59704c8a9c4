"""The pictures of the page and of `piezod watch` for the documentation: `make screenshots`.

They are taken of the simulated stage, in a chromium without a window, and stored with few colours.
"""

import io
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.browser.machine import ROOT, Machine
from tests.browser.terminal import picture_of_watch

IMAGES: Final = ROOT / "docs" / "images"
DESKTOP: Final = (1920, 1080)
TABLET: Final = (820, 1180)
COLOURS: Final = 256
ROUNDS: Final = 3
"""Of moving the colours to where they are needed; without, grounds get a tint."""
READY_WITHIN_MS: Final = 60_000
"""The spectrum needs the telemetry of nine seconds."""


def main() -> None:
    """Take all pictures."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as playwright, TemporaryDirectory(prefix="pz") as folder:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        machine = Machine(Path(folder))
        try:
            machine.start_stage()
            socket = machine.folder / "run" / "piezod" / "simulated" / "api.sock"
            take_all(browser, machine.start_web(), socket)
        finally:
            browser.close()
            machine.stop()


def take_all(browser: Browser, address: str, socket: Path) -> None:
    """Take the pictures of a stage that is at rest at first."""
    page = opened(browser, address, DESKTOP, "light")
    page.get_by_role("button", name="Arm", exact=True).click()
    page.get_by_role("radio", name="adaptive").check()
    page.get_by_label("Duration").fill("600")
    page.get_by_role("button", name="Start the wave").click()
    wait_for_charts(page)
    save(page, "page-light")
    page.emulate_media(color_scheme="dark")
    save(page, "page-dark")
    store(picture_of_watch(browser, socket), "watch")
    tablet = opened(browser, address, TABLET, "dark")
    tablet.wait_for_timeout(10_000)  # ms, until the first chart is full
    save(tablet, "page-tablet")
    page.bring_to_front()
    page.get_by_role("button", name="Emergency stop").click()
    expect(page.locator("#state")).to_contain_text("FAULT")
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(page.get_by_text("cannot arm in FAULT")).to_be_visible()
    save(page, "page-fault")


def opened(browser: Browser, address: str, size: tuple[int, int], scheme: str) -> Page:
    """Return the page of the stage in a window of its own, with its state known."""
    width, height = size
    dark = "dark" if scheme == "dark" else "light"
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=dark)
    page.goto(address)
    expect(page.locator("#state")).not_to_contain_text("…")
    return page


def wait_for_charts(page: Page) -> None:
    """Wait until each chart of a page has data."""
    expect(page.get_by_text("faster errors are folded in")).to_be_visible(timeout=READY_WITHIN_MS)
    page.get_by_role("radio", name="10 s").focus()
    page.evaluate("document.activeElement.blur(); scrollTo(0, 0)")


def save(page: Page, name: str) -> None:
    """Store a picture of what a person sees."""
    page.wait_for_timeout(1_000)  # ms, until the charts have the colours of the theme
    store(page.screenshot(), name)


def store(png: bytes, name: str) -> None:
    """Store a picture with few colours, so that it is a small file."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, ROUNDS, dither=Image.Dither.NONE)
    path = IMAGES / f"{name}.png"
    few.save(path, optimize=True)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
