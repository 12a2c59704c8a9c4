"""Somebody identifies an axis, and lets a waveform be learned."""

import json
import re

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.machine import EMULATED, SIMULATED, Machine

pytestmark = pytest.mark.browser

DRIVEN_WITHIN_MS = 90_000


def dialog(page: Page, opener: str) -> Locator:
    """Open a dialog by its button; return it."""
    page.get_by_role("button", name=opener).click()
    return page.get_by_role("dialog")


def start_identification(page: Page, seconds: int) -> Locator:
    """Start an identification with a short drive; return its dialog."""
    found = dialog(page, "Identify")
    found.get_by_label("Drive").select_option(label="decaying swings")
    found.get_by_label("Duration").fill(str(seconds))
    found.get_by_label("Model").select_option(label="stop operators")
    found.get_by_role("button", name="Start").click()
    return found


def model_of(machine: Machine) -> object:
    """Return the source of the model that the stage uses, which tells it from another one."""
    return json.loads(machine.run("params", "list", "--json"))["axes"]["x"]["model"]["source"]


@pytest.mark.parametrize("page", [SIMULATED, EMULATED], indirect=True)
def test_an_identified_model_is_used_and_saved(page: Page, machine: Machine) -> None:
    """The result has errors and a figure; the stage uses the model when it is accepted."""
    found = start_identification(page, 5)
    expect(found.get_by_role("status")).to_contain_text("Driving axis x", timeout=30_000)
    expect(page.locator("#state")).to_contain_text("IDENT")

    accept = found.get_by_role("button", name="Use this model")
    accept.wait_for(timeout=DRIVEN_WITHIN_MS)
    expect(found).to_contain_text("Error on another drive")
    expect(found.get_by_role("table")).to_contain_text("held-out blocks")
    figure = found.get_by_role("img", name="Measured and model")
    assert figure.evaluate("image => image.naturalWidth") > 500
    accept.click()
    expect(found.get_by_role("status")).to_contain_text("uses this model from now on")
    found.get_by_role("button", name="Save the parameters").click()
    expect(page.get_by_text("The parameters are saved.").first).to_be_visible()
    assert '"method": "least-squares"' in machine.run("params", "list", "--json")


def test_a_rejected_model_changes_nothing(page: Page, machine: Machine) -> None:
    """Reject leads back to the form, and the stage keeps its model."""
    before = model_of(machine)
    found = start_identification(page, 5)
    reject = found.get_by_role("button", name="Reject it")
    reject.wait_for(timeout=DRIVEN_WITHIN_MS)
    reject.click()

    expect(found.get_by_role("button", name="Start")).to_be_visible()
    expect(found.get_by_role("table")).to_be_hidden()
    assert model_of(machine) == before


def test_an_identification_is_seen_by_a_new_tab_and_stopped_there(
    page: Page, machine: Machine
) -> None:
    """It goes on when its tab is closed; stopped, it leaves the stage without voltage."""
    found = start_identification(page, 60)
    expect(found.get_by_role("status")).to_contain_text("Driving axis x", timeout=30_000)
    other = page.context.new_page()
    other.goto(page.url)
    page.close()
    found = dialog(other, "Identify")
    expect(found.get_by_role("status")).to_contain_text("Driving axis x")

    found.get_by_role("button", name="Stop it").click()

    expect(found).to_contain_text("Ended as requested")
    expect(other.locator("#state")).to_contain_text("SAFE")
    assert '"drive_v": 0.0' in machine.run("status", "--json")


def test_a_waveform_is_learned_pass_by_pass(page: Page) -> None:
    """The error of each pass is shown, and falls; the best table is kept."""
    found = dialog(page, "Play and learn")
    found.get_by_label("Passes").fill("2")
    found.get_by_text("Table and times").click()
    found.get_by_label("Settle").fill("0.2")
    found.get_by_label("Record").fill("0.2")
    found.get_by_role("button", name="Start").click()
    found.get_by_role("button", name="Play another").wait_for(timeout=DRIVEN_WITHIN_MS)

    rows = found.get_by_role("row").filter(has_text=re.compile("inverse|pass"))
    worst_pct = [float(row.get_by_role("cell").first.inner_text()) for row in rows.all()]
    assert len(worst_pct) == 3
    assert worst_pct[-1] < worst_pct[0] / 2
    expect(found.get_by_role("row", name="(best)")).to_be_visible()
    assert "Error of each pass" in (found.get_by_role("img").get_attribute("aria-label") or "")


def test_what_cannot_be_learned_is_refused_in_words(page: Page) -> None:
    """A command beyond the model is refused with value and limit, and the form stays."""
    found = dialog(page, "Play and learn")
    found.get_by_label("High").fill("60")
    found.get_by_role("button", name="Start").click()
    expect(found.get_by_role("alert")).to_contain_text("60 µm", timeout=DRIVEN_WITHIN_MS)
    expect(found.get_by_label("High")).to_have_value("60")


def test_escape_closes_a_dialog_and_focus_returns(page: Page) -> None:
    """A dialog is used with the keyboard alone."""
    found = dialog(page, "Play and learn")
    expect(found.get_by_role("heading")).to_be_focused()
    page.keyboard.press("Escape")
    expect(found).to_have_count(0)
    expect(page.get_by_role("button", name="Play and learn")).to_be_focused()
