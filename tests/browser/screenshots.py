"""The pictures of the page and of `piezod watch` for the documentation: `make screenshots`.

They are taken of the simulated stage, in a chromium without a window, and stored with few colours.
"""

import io
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.browser.machine import ROOT, Machine
from tests.browser.terminal import picture_of_watch

IMAGES: Final = ROOT / "docs" / "images"
SIZES: Final = {"desktop": (1920, 1080), "tablet": (820, 1180)}
SCHEMES: Final[tuple[Literal["light", "dark"], ...]] = ("light", "dark")
COLOURS: Final = 128
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
            address = machine.start_web()
            socket = machine.folder / "run" / "piezod" / "simulated" / "api.sock"
            for size in SIZES:
                take_page(browser, address, size, socket)
        finally:
            browser.close()
            machine.stop()


def take_page(browser: Browser, address: str, size: str, socket: Path) -> None:
    """Take the pictures of a stage at rest, while it follows a wave, and after its emergency stop.

    Args:
        browser: The browser.
        address: Address of the page.
        size: A name of `SIZES`.
        socket: Socket of the stage; with a page for a desktop, `piezod watch` is taken, too.
    """
    width, height = SIZES[size]
    page = browser.new_page(viewport={"width": width, "height": height}, has_touch=size == "tablet")
    page.set_default_timeout(READY_WITHIN_MS)
    page.goto(address)
    expect(page.get_by_role("button", name="Arm", exact=True)).to_be_enabled()
    page.wait_for_timeout(11_000)  # ms, until the charts are full
    save(page, f"page-idle-{size}")
    page.get_by_role("button", name="Arm", exact=True).click()
    page.get_by_role("radio", name="adaptive").check()
    page.get_by_label("Duration").fill("600")
    page.get_by_role("button", name="Start the wave").click()
    if size == "desktop":  # on a tablet the spectrum is below what is seen, and not drawn
        expect(page.get_by_text("faster errors folded in")).to_be_visible(timeout=READY_WITHIN_MS)
    page.wait_for_timeout(11_000)
    page.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
    save(page, f"page-run-{size}")
    if size == "desktop":
        store(picture_of_watch(browser, socket), "watch")
    page.get_by_role("radio", name="30 s").check()  # so that the wave before the stop is seen
    page.get_by_role("button", name="Emergency stop").click()
    expect(page.locator("#state")).to_contain_text("FAULT")
    page.get_by_role("button", name="Close this message").click()
    page.mouse.move(0, 0)
    save(page, f"page-fault-{size}")
    page.get_by_role("button", name="Reset", exact=True).click()
    expect(page.locator("#state")).to_contain_text("SAFE")
    page.close()  # its lease is released


def save(page: Page, name: str) -> None:
    """Store pictures of what a person sees, in each theme."""
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        page.wait_for_timeout(1_000)  # ms, until the charts have the colours of the theme
        store(page.screenshot(), f"{name}-{scheme}")


def store(png: bytes, name: str) -> None:
    """Store a picture with few colours, so that it is a small file."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, ROUNDS, dither=Image.Dither.NONE)
    path = IMAGES / f"{name}.png"
    few.save(path, optimize=True)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
