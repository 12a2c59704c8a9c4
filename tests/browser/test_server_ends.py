"""The server of the page ends while the page drives a stage."""

import signal
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from tests.browser.machine import Machine
from tests.browser.test_dialogs import start_identification
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_stage_is_stopped_when_the_server_of_the_page_ends(
    page: Page, machine: Machine, number: signal.Signals
) -> None:
    """An identification that the page has started does not drive the stage without its server."""
    found = start_identification(page, 100)
    expect(found.get_by_role("status")).to_contain_text("Driving axis x")
    expect(page.locator("#state")).to_contain_text("IDENT")

    machine.web.send_signal(number)

    eventually(lambda: '"state": "SAFE"' in machine.run("status", "--json"), 40.0)
    machine.web.wait(20.0)


def test_a_server_that_was_started_again_asks_for_its_new_address(
    page: Page, machine: Machine
) -> None:
    """Its token is another one: the page says so until any tab has opened the new address."""
    expect(page.locator("#state")).to_contain_text("SAFE")
    port = urlsplit(page.url).port
    machine.web.send_signal(signal.SIGTERM)
    machine.web.wait(20.0)

    address = machine.start_web("--port", str(port))

    message = "piezod web was started again: open the address that it printed"
    expect(page.get_by_text(message)).to_be_visible()
    page.context.new_page().goto(address)
    expect(page.get_by_text("connected", exact=True)).to_be_visible()
    expect(page.get_by_text(message)).to_be_hidden()
