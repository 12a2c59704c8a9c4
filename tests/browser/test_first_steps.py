"""What everybody does first."""

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser


def test_a_stage_is_armed_and_stopped(page: Page) -> None:
    """The buttons arm and stop the stage, and the page shows its state."""
    state = page.locator("#state")
    expect(state).to_contain_text("SAFE")
    page.get_by_role("button", name="Arm").click()
    expect(state).to_contain_text("READY")
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(state).to_contain_text("SAFE")
    assert "token" not in page.url
