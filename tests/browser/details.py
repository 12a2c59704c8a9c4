"""What the details of the page show. Apart, because only tests in the browser have playwright."""

import re

from playwright.sync_api import Page, expect


def expect_reached(page: Page, target_um: float) -> None:
    """Expect the details to show that the stage is on a target, in µm."""
    details = page.get_by_role("region", name="Details")
    expect(details).to_contain_text(re.compile(rf"target\s*{target_um:.3f} µm"))
    expect(details).to_contain_text(re.compile(r"on target\s*yes"))
