"""Fixtures of the tests in a browser, which `make browser` runs."""

import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import pytest

from tests.browser.machine import EMULATED, SIMULATED, Machine

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page

WITHIN_MS = 30_000
"""Longest wait of any step: a generous one, which only ends a failing test."""

# Without the environment of `make browser` these files cannot even be imported.
collect_ignore_glob = [] if find_spec("playwright") else ["test_*.py"]


@pytest.fixture(scope="session")
def browser() -> "Iterator[Browser]":
    """Yield the chromium of this machine."""
    from playwright.sync_api import expect, sync_playwright  # noqa: PLC0415 - see above

    expect.set_options(timeout=WITHIN_MS)

    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("no chromium in PATH: install the package `chromium`")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def machine() -> Iterator[Machine]:
    """Yield a machine without a running stage."""
    with TemporaryDirectory(prefix="pz") as folder:  # the path of a socket must be short
        machine = Machine(Path(folder))
        yield machine
        machine.stop()


@pytest.fixture
def context(browser: "Browser") -> "Iterator[BrowserContext]":
    """Yield a window of the browser; a test fails if a page has an error that nobody handles."""
    errors: list[str] = []
    context = browser.new_context(viewport={"width": 1400, "height": 1000})
    context.set_default_timeout(WITHIN_MS)
    context.on("weberror", lambda found: errors.append(str(found.error)))
    yield context
    context.close()
    assert not errors


@pytest.fixture
def page(request: pytest.FixtureRequest, context: "BrowserContext", machine: Machine) -> "Page":
    """Return the page of a machine with the stage that a test asks for: else the simulated one."""
    if getattr(request, "param", SIMULATED) == EMULATED:
        machine.start_emulated_stage()
    else:
        machine.start_stage()
    page = context.new_page()
    page.goto(machine.start_web())
    return page
