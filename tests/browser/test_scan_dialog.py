"""Somebody scans a raster by the loop of two axes."""

import re

import pytest
from playwright.sync_api import BrowserContext, expect

from tests.browser.machine import SIMULATED, Machine
from tests.browser.test_dialogs import DRIVEN_WITHIN_MS, dialog

pytestmark = pytest.mark.browser


def with_second_axis(machine: Machine) -> None:
    """Add an axis y, which is as x, to the simulated stage; its loop is slower."""
    file = machine.config / f"{SIMULATED}.yaml"
    text = re.sub("rate_hz: .*", "rate_hz: 50", file.read_text(), count=1)
    text = re.sub("gain_per_s: .*?,", "gain_per_s: 5,", text)
    file.write_text(text + text.partition("axes:\n")[2].replace("  x:\n", "  y:\n", 1))


def test_the_picture_of_a_scan_by_the_loop_is_shown(
    machine: Machine, context: BrowserContext
) -> None:
    """The outline is drawn before; the picture, and its errors, afterwards."""
    with_second_axis(machine)
    machine.start_stage()
    page = context.new_page()
    page.goto(machine.start_web())
    expect(page.locator("#state")).to_contain_text("SAFE")
    found = dialog(page, "Scan…")
    found.get_by_label("By").select_option(label="loop, trimmed")
    for pixels in found.get_by_label("Pixels").all():
        pixels.fill("4")
    found.get_by_label("Lines per second").fill("2")
    expect(found.get_by_role("img", name="The scan within")).to_be_visible()
    found.get_by_role("button", name="Start").click()
    found.get_by_role("button", name="Scan again").wait_for(timeout=DRIVEN_WITHIN_MS)

    expect(found.get_by_role("img", name="Picture of 4 lines")).to_be_visible()
    expect(found.get_by_role("row", name="stored")).to_be_visible()
