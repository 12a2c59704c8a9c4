"""Controls of the sensor and of the hysteresis memory, and what a fault tells to do."""

import json
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.machine import Machine
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.browser

CONDITIONED_WITHIN_MS = 60_000


def arm(page: Page) -> None:
    """Arm the stage."""
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(page.locator("#state")).to_contain_text("READY")


def zero_um(machine: Machine) -> float:
    """Return the sensor zero of the axis, in µm."""
    zero: float = json.loads(machine.run("params", "list", "--json"))["axes"]["x"]["zero_um"]
    return zero


def faults(machine: Machine) -> list[dict[str, Any]]:
    """Return the faults of the stage."""
    found: list[dict[str, Any]] = json.loads(machine.run("status", "--json"))["faults"]
    return found


def test_zero_takes_the_displacement_at_rest(page: Page, machine: Machine) -> None:
    """The sensor gets a zero, and the event log names the tab that asked for it."""
    arm(page)
    assert zero_um(machine) == 0.0

    page.get_by_role("button", name="Zero the sensor").click()

    expect(page.locator(".event-panel")).to_contain_text("zero axis: x")
    eventually(lambda: zero_um(machine) != 0.0, 20.0)
    expect(page.get_by_role("region", name="Mode", exact=True).get_by_role("status")).to_be_empty()


def test_condition_drives_a_swing_and_ends_by_itself(page: Page) -> None:
    """The stage is busy while it is conditioned, and ready again afterwards."""
    condition = page.get_by_role("button", name="Condition")
    expect(condition).to_be_disabled()
    arm(page)

    condition.click()

    state = page.locator("#state")
    expect(state).to_contain_text("IDENT")
    expect(condition).to_be_disabled()
    expect(state).to_contain_text("READY", timeout=CONDITIONED_WITHIN_MS)
    expect(condition).to_be_enabled()


def test_a_fault_shows_its_remedy(page: Page, machine: Machine) -> None:
    """Each latched fault stands above everything else, with what to do in the daemon's words."""
    page.get_by_role("button", name="Emergency stop").click()
    banner = page.get_by_label("Faults that are latched")
    expect(banner).to_be_visible()

    latched = [each for each in faults(machine) if each["latched"]]
    assert [each["id"] for each in latched] == ["E1"]
    for each in latched:
        line = banner.get_by_role("listitem").filter(has_text=each["id"])
        expect(line).to_contain_text(each["name"])
        expect(line).to_contain_text(f"What to do: {each['remedy'].replace('`', '')}")
