"""Controls that cannot be used now: each is barred, with its reason in words."""

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from tests.browser.machine import Machine

pytestmark = pytest.mark.browser

ARM_FIRST = "Not now: arm first"


def reasons(page: Page) -> dict[str, str]:
    """Return the titles of the buttons of the card Stage that are barred."""
    card = page.get_by_role("region", name="Stage", exact=True)
    barred = card.locator("button[aria-disabled=true]")
    found: dict[str, str] = barred.evaluate_all(
        "all => Object.fromEntries(all.map(each => [each.textContent, each.title]))"
    )
    return found


def test_stage_that_is_not_armed(page: Page) -> None:
    """Nothing can be moved, and each card says that Arm comes first."""
    page.get_by_role("button", name="Arm", exact=True).wait_for()
    go = page.get_by_role("button", name="Go")
    expect(go).to_be_disabled()
    expect(go).to_have_accessible_description(ARM_FIRST)
    for name in ("Position", "Waveform"):
        card = page.get_by_role("region", name=name, exact=True)
        expect(card.get_by_text(ARM_FIRST)).to_be_visible()
    assert reasons(page) == {
        "Hold": "Not now: nothing is driven",
        "Resume": "Not now: nothing is held",
        "Reset": "Not now: no fault is latched",
    }

    # By the keyboard a barred control says its reason, and sends nothing.
    page.get_by_role("spinbutton", name="Position").press("Enter")
    expect(page.get_by_role("region", name="Position").get_by_role("status")).to_have_text(
        ARM_FIRST
    )
    page.get_by_role("button", name="Arm", exact=True).click()

    expect(go).to_be_enabled()
    expect(page.get_by_role("region", name="Position").get_by_role("status")).to_be_empty()
    expect(page.get_by_role("slider", name="Set-point")).to_be_enabled()
    assert reasons(page)["Arm"] == "Not now: armed already"


def test_stage_in_fault(page: Page) -> None:
    """Reset is what can be done."""
    page.get_by_role("button", name="Emergency stop").click()
    expect(page.locator("#state")).to_contain_text("FAULT")
    expect(page.get_by_role("button", name="Reset", exact=True)).to_be_enabled()

    assert reasons(page) == {
        "Arm": "Not now: reset first",
        "Hold": "Not now: nothing is driven",
        "Resume": "Not now: reset first",
    }


def test_lease_of_another_client(page: Page, context: BrowserContext) -> None:
    """The other tab names who has the lease, and can still hold, stop and record."""
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(page.get_by_text("lease: this page")).to_be_visible()
    other = context.new_page()
    other.goto(page.url)
    card = other.get_by_role("region", name="Stage", exact=True)

    expect(card).to_contain_text("has the lease")
    assert reasons(other).keys() == {"Arm", "Resume", "Reset"}
    expect(other.get_by_role("button", name="Record", exact=True)).to_be_enabled()
    expect(other.get_by_role("radio", name="adaptive")).to_be_disabled()

    page.close()
    expect(card).not_to_contain_text("has the lease")


def test_page_of_a_viewer(context: BrowserContext, machine: Machine) -> None:
    """Every control but the emergency stop names the role that it needs."""
    machine.start_stage()
    page = context.new_page()
    tokens = machine.folder / "tokens"
    address, _, _ = machine.start_web("--tokens", str(tokens)).partition(" ")
    page.goto(f"{address}?token={(tokens / 'viewer').read_text().strip()}")
    needs = "needs the role operator; this page has viewer"
    for name in ("Stage", "Mode", "Position", "Waveform", "Recording"):
        card = page.get_by_role("region", name=name, exact=True)
        expect(card.get_by_text(f"Not now: {needs}")).to_be_visible()
        for button in card.get_by_role("button").all():
            expect(button).to_be_disabled()
    page.get_by_role("button", name="Identify…").click()
    expect(page.get_by_role("button", name="Start", exact=True)).to_be_disabled()
    expect(page.get_by_text("needs the role engineer; this page has viewer")).to_be_visible()

    page.get_by_role("button", name="Emergency stop").click()
    expect(page.locator("#state")).to_contain_text("FAULT")
