"""The page with a screen reader and with a keyboard."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from tests.browser.details import expect_reached
from tests.browser.machine import Machine

pytestmark = pytest.mark.browser


def violations(page: Page) -> list[str]:
    """Return what axe-core finds in a page: the rule, and the elements that break it."""
    found = Axe().run(page).response["violations"]
    return [f"{each['id']}: {node['html'][:200]}" for each in found for node in each["nodes"]]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(page: Page, scheme: str) -> None:
    """Every page has names, contrast and landmarks in both themes: at rest, in RUN, in FAULT."""
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    state = page.locator("#state")
    expect(state).to_contain_text("SAFE")
    found = violations(page)

    page.get_by_role("button", name="Arm", exact=True).click()
    expect(state).to_contain_text("READY")
    page.get_by_role("button", name="Start the wave").click()
    expect(state).to_contain_text("RUN")
    found += violations(page)

    page.get_by_role("button", name="Emergency stop").click()
    expect(state).to_contain_text("FAULT")
    page.get_by_role("button", name="Arm", exact=True).press("Enter")
    refusal = page.get_by_role("region", name="Stage", exact=True).get_by_role("status")
    expect(refusal).to_contain_text("Not now: reset first")
    found += violations(page)

    page.get_by_role("link", name="Recordings").click()
    expect(page.get_by_role("heading", name="Recordings")).to_be_visible()
    found += violations(page)
    page.get_by_role("link", name="piezod, all stages").click()
    expect(page.get_by_role("heading", name="Stages of this machine")).to_be_visible()
    found += violations(page)

    assert not found


def problems_on(page: Page, width_px: int) -> list[str]:
    """Return what axe-core finds, how much wider than the screen the page is, and a hidden stop."""
    wide_px = page.evaluate("document.documentElement.scrollWidth")
    wider = [f"{page.url}: {wide_px} px on {width_px} px"] if wide_px > width_px else []
    stop = page.get_by_role("button", name="Emergency stop").bounding_box()
    if stop is None or stop["x"] < 0 or stop["x"] + stop["width"] > width_px:
        wider.append(f"{page.url}: the emergency stop is at {stop}")
    return [*violations(page), *wider]


@pytest.mark.parametrize(("width_px", "height_px"), [(390, 844), (768, 1024), (1024, 768)])
def test_phone_and_tablet_show_the_whole_width(
    browser: Browser, machine: Machine, width_px: int, height_px: int
) -> None:
    """Nothing is beside the screen, and axe finds nothing: SAFE, RUN, FAULT, viewer."""
    machine.start_stage()
    screen = {"width": width_px, "height": height_px}
    with browser.new_context(viewport=screen, has_touch=True, is_mobile=True) as context:
        page = context.new_page()
        page.goto(machine.start_web())
        state = page.locator("#state")
        expect(state).to_contain_text("SAFE")
        found = problems_on(page, width_px)

        page.get_by_role("button", name="Arm", exact=True).tap()
        page.get_by_role("button", name="Start the wave").tap()
        page.get_by_role("button", name="Record", exact=True).tap()
        expect(state).to_contain_text("RUN")
        found += problems_on(page, width_px)
        page.get_by_role("button", name="Emergency stop").tap()
        expect(state).to_contain_text("FAULT")
        page.get_by_role("button", name="Identify").tap()
        expect(page.get_by_role("dialog")).to_be_visible()
        found += problems_on(page, width_px)

        page.get_by_role("button", name="Close Identify").tap()
        machine.run("record", "stop")
        page.get_by_role("link", name="Recordings").tap()
        row = page.get_by_role("row").filter(has_text="Download")
        expect(row).to_be_visible()
        found += problems_on(page, width_px)
        row.get_by_role("link").first.tap()
        expect(page.get_by_role("region", name="List of marks")).to_contain_text("FAULT")
        found += problems_on(page, width_px)

    assert not found


def test_stage_moves_by_keyboard(page: Page) -> None:
    """Arrow keys move the stage in steps, and Escape twice stops it."""
    state = page.locator("#state")
    page.get_by_role("button", name="Arm", exact=True).press("Enter")
    expect(state).to_contain_text("READY")
    up = page.get_by_role("button", name="One step up")
    up.focus()
    page.keyboard.press("Shift+ArrowUp")
    expect_reached(page, 10.0)
    page.keyboard.press("ArrowLeft")
    expect_reached(page, 9.0)

    page.keyboard.press("Escape")
    page.keyboard.press("Escape")

    expect(state).to_contain_text("FAULT")
    expect(page.get_by_label("Faults that are latched")).to_contain_text("E1")
