"""What a person does with a stage from the page, from the first click to the last."""

import re
import signal

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from tests.browser.details import expect_reached
from tests.browser.machine import EMULATED, SIMULATED, Machine
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.browser

TABS = 6
CONDITIONED_WITHIN_MS = 60_000


def arm(page: Page) -> None:
    """Arm the stage."""
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(page.locator("#state")).to_contain_text("READY")


@pytest.mark.parametrize("page", [SIMULATED, EMULATED], indirect=True)
def test_a_set_point_is_dragged_and_a_wave_follows_in_another_mode(
    page: Page, machine: Machine
) -> None:
    """The stage follows the slider, then a wave; its recording has both, and it is stopped."""
    arm(page)
    page.get_by_role("button", name="Condition").click()  # without a read-back, adaptive needs it
    expect(page.locator("#state")).to_contain_text("IDENT")
    expect(page.locator("#state")).to_contain_text("READY", timeout=CONDITIONED_WITHIN_MS)
    page.get_by_label("Label of the recording").fill("all")
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_enabled()

    slider = page.get_by_role("slider", name="Set-point")
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 8, middle)
    page.mouse.down()
    for step in range(1, 11):
        page.mouse.move(box["x"] + 8 + step * box["width"] / 20, middle)
    page.mouse.up()
    expect(page.locator("#state")).to_contain_text("RUN")
    wanted_um = float(slider.input_value())
    assert 5.0 < wanted_um < 20.0
    expect_reached(page, wanted_um)

    page.get_by_role("radio", name="adaptive").check()
    page.get_by_role("button", name="Start the wave").click()
    expect(page.get_by_role("radio", name="adaptive")).to_be_checked()
    page.get_by_role("button", name="Hold", exact=True).click()
    expect(page.locator("#state")).to_contain_text("HOLD")
    page.get_by_role("button", name="Stop recording").click()
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.locator("#state")).to_contain_text("SAFE")
    assert '"mode": "adaptive"' in machine.run("status", "--json")

    page.get_by_role("link", name="Recordings").click()
    page.get_by_role("link", name=re.compile("^[0-9]+T[0-9]+Z-all$")).click()
    marks = page.get_by_role("region", name="List of marks")
    expect(marks).to_contain_text("RUN to HOLD")


@pytest.mark.parametrize("page", [SIMULATED, EMULATED], indirect=True)
def test_an_emergency_stop_works_with_six_tabs_open(
    page: Page, context: BrowserContext, machine: Machine
) -> None:
    """Each tab shows the moving stage; one stops it, and all see it."""
    arm(page)
    page.get_by_role("button", name="Start the wave").click()
    expect(page.locator("#state")).to_contain_text("RUN")
    tabs = [page]
    for _ in range(TABS - 1):
        tabs.append(context.new_page())
        tabs[-1].goto(page.url)
    for tab in tabs:
        expect(tab.locator("#state")).to_contain_text("RUN")

    tabs[-1].bring_to_front()
    tabs[-1].get_by_role("button", name="Emergency stop").click()

    for tab in tabs:
        expect(tab.locator("#state")).to_contain_text("FAULT")
        expect(tab.get_by_label("Faults that are latched")).to_contain_text("E1")
    assert '"state": "FAULT"' in machine.run("status", "--json")


def test_what_to_do_stands_beside_a_control_that_is_barred(page: Page) -> None:
    """In SAFE nothing moves: Go is barred, and its card says what comes first."""
    expect(page.locator("#state")).to_contain_text("SAFE")
    expect(page.get_by_role("button", name="Go", exact=True)).to_be_disabled()
    expect(page.get_by_role("region", name="Position")).to_contain_text("Not now: arm first")


def test_the_page_goes_on_when_a_killed_daemon_runs_again(page: Page, machine: Machine) -> None:
    """The page says that the stage is away, and moves it again without being loaded anew."""
    arm(page)
    state = page.locator("#state")
    machine.stage.send_signal(signal.SIGKILL)
    machine.stage.wait()
    expect(state).to_contain_text("away")

    machine.start_stage()

    expect(state).not_to_contain_text("away", timeout=60_000)
    expect(page.get_by_role("region", name="Details")).to_contain_text("did not end cleanly")
    page.get_by_text("Options of Arm and Reset").click()
    page.get_by_role("checkbox", name="Reset as engineer").check()

    def is_reset() -> bool:  # refused until the fault has been gone for a second
        # By force: once it is done, the button is barred.
        page.get_by_role("button", name="Reset", exact=True).click(force=True)
        return "SAFE" in state.inner_text()

    eventually(is_reset)
    arm(page)
