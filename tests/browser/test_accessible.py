"""The page with a screen reader and with a keyboard."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

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


def test_stage_moves_by_keyboard(page: Page) -> None:
    """Arrow keys move the stage in steps, and Escape twice stops it."""
    state = page.locator("#state")
    page.get_by_role("button", name="Arm", exact=True).press("Enter")
    expect(state).to_contain_text("READY")
    up = page.get_by_role("button", name="One step up")
    up.focus()
    page.keyboard.press("Shift+ArrowUp")
    expect(page.get_by_text("10.000 µm, reached")).to_be_visible()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_text("9.000 µm, reached")).to_be_visible()

    page.keyboard.press("Escape")
    page.keyboard.press("Escape")

    expect(state).to_contain_text("FAULT")
    expect(page.get_by_label("Faults that are latched")).to_contain_text("E1")
