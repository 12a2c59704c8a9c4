"""The page in a folder of a reverse proxy."""

from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.machine import Machine
from tests.web import proxies
from tests.web.remote import new_certificate

pytestmark = pytest.mark.browser


def test_page_works_in_a_folder_of_nginx(
    browser: Browser, machine: Machine, tmp_path: Path
) -> None:
    """Files, WebSocket, recordings and downloads are found below the address of the proxy."""
    machine.start_stage()
    port, web_port = proxies.free_port(), proxies.free_port()
    address = f"https://localhost:{port}{proxies.PATH}"
    url = machine.start_web("--port", str(web_port), "--public-url", address)
    certificate = new_certificate(tmp_path)
    with (
        proxies.running("nginx", tmp_path, certificate, port, web_port),
        browser.new_context(ignore_https_errors=True) as context,
    ):
        page = context.new_page()
        failed: list[str] = []
        page.on("requestfailed", lambda request: failed.append(request.url))
        page.on(
            "response", lambda answer: failed.append(answer.url) if answer.status >= 400 else None
        )
        page.goto(url)
        expect(page.locator("#state")).to_contain_text("SAFE")
        page.get_by_role("button", name="Record", exact=True).click()
        expect(page.get_by_text("recording 2")).to_be_visible()
        machine.run("record", "stop")
        page.get_by_role("link", name="Recordings").click()
        with page.expect_download() as download:
            page.get_by_role("link", name="Download").click()

        assert urlsplit(page.url).path == proxies.PATH
        assert download.value.path().stat().st_size
        assert [each for each in failed if "/recordings/" not in each] == []
