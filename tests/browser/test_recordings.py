"""Somebody looks at a recording."""

import h5py
import pytest
from playwright.sync_api import Page, expect

from tests.browser.machine import Machine
from tests.browser.test_accessible import violations

pytestmark = pytest.mark.browser


def record(machine: Machine, label: str) -> None:
    """Record a movement of the stage."""
    machine.run("arm")
    machine.run("record", "start", label)
    machine.run("goto", "12", "--wait")
    machine.run("record", "stop")


def test_a_recording_is_found_looked_at_and_downloaded(page: Page, machine: Machine) -> None:
    """The list leads to the viewer, which zooms and changes its columns; the file is whole."""
    record(machine, "scan")
    page.get_by_role("link", name="Recordings").click()
    row = page.get_by_role("row").filter(has_text="-scan")
    expect(row).to_contain_text("axis x")
    expect(row).to_contain_text("cycles at 200 Hz")
    keep = row.get_by_role("checkbox", name="Keep")
    keep.check()
    page.reload()
    expect(row.get_by_role("checkbox", name="Keep")).to_be_checked()

    row.get_by_role("link", name="-scan", exact=False).first.click()
    plot = page.get_by_role("img", name="Recording over time")
    expect(plot.locator("canvas")).to_be_visible()
    shown = page.get_by_role("group", name="What is shown").locator("output")
    whole = shown.inner_text()
    page.get_by_role("button", name="Zoom in").click()
    expect(shown).not_to_have_text(whole)
    plot.focus()
    page.keyboard.press("Home")
    expect(shown).to_have_text(whole)
    page.get_by_label("Right").select_option(label="x: drive, V")
    expect(page.locator("figcaption").first).to_contain_text("x: drive, V")
    expect(page.get_by_role("region", name="List of marks")).to_contain_text("READY to RUN")

    with page.expect_download() as download:
        page.get_by_role("link", name="Download").click()
    with h5py.File(download.value.path()) as file:
        assert file["recording/cycles/t_s"].shape[0] > 0


def test_a_table_that_cannot_be_made_is_barred(page: Page) -> None:
    """The reason stands beside it, and it leads nowhere."""
    expect(page.locator("#state")).to_contain_text("SAFE")
    page.evaluate(
        """async () => {
            const { exportLinks } = await import("./static/recording_list.js");
            const why = { csv: "", parquet: "install `pyarrow`" };
            const links = exportLinks("simulated", "scan", why);
            document.getElementById("main").replaceChildren(...links.flat());
        }"""
    )
    barred = page.get_by_role("link", name="Export as Parquet")

    expect(page.get_by_role("link", name="Export as CSV")).to_have_attribute(
        "href", "recordings/simulated/scan/csv"
    )
    expect(barred).to_be_disabled()
    assert barred.get_attribute("href") is None
    expect(page.get_by_text("install pyarrow")).to_be_visible()


def test_a_recording_is_exported_and_replayed(page: Page, machine: Machine) -> None:
    """The viewer saves the table, and replays with the present model: errors, verdict, figure."""
    record(machine, "scan")
    page.get_by_role("link", name="Recordings").click()
    row = page.get_by_role("row").filter(has_text="-scan")
    row.get_by_role("link", name="-scan", exact=False).first.click()
    with page.expect_download() as download:
        page.get_by_role("link", name="Export as CSV").click()
    lines = download.value.path().read_text().splitlines()
    assert "position_um" in lines[0]
    assert len(lines) > 10

    page.get_by_role("button", name="Replay").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Start").click()
    expect(dialog.get_by_role("table")).to_contain_text("feedforward", timeout=60_000)
    expect(dialog).to_contain_text("The errors of the replay, with present-model.yaml")
    figure = dialog.get_by_role("img", name="Recorded and replayed error")
    expect(figure).to_be_visible()
    assert figure.evaluate("image => image.decode().then(() => image.naturalWidth)") > 500
    assert not violations(page)


def test_a_recording_in_progress_grows_as_it_is_looked_at(page: Page, machine: Machine) -> None:
    """The viewer shows what is added meanwhile."""
    machine.run("record", "start", "long")
    page.get_by_role("link", name="Recordings").click()
    row = page.get_by_role("row").filter(has_text="-long")
    expect(row).to_contain_text("in progress")
    row.get_by_role("link").click()
    about = page.locator(".about")
    before = about.inner_text()
    expect(about).not_to_have_text(before)
    machine.run("record", "stop")


def test_a_recording_that_does_not_exist_is_refused_in_words(page: Page) -> None:
    """The address of no recording says so."""
    page.get_by_role("link", name="Recordings").click()
    page.goto(f"{page.url}/20240501T120000Z")
    expect(page.locator("main")).to_contain_text("no recording '20240501T120000Z'")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_in_viewer_and_dialogs(page: Page, machine: Machine, scheme: str) -> None:
    """List, viewer and dialogs have names, contrast and structure in both themes."""
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    record(machine, "scan")
    for name in ("Identify", "Play and learn"):
        page.get_by_role("button", name=name).click()
        expect(page.get_by_role("dialog")).to_be_visible()
        found = violations(page)
        assert not found
        page.get_by_role("button", name=f"Close {name}").click()
    page.get_by_role("link", name="Recordings").click()
    row = page.get_by_role("row").filter(has_text="-scan")
    expect(row).to_contain_text("cycles at")
    assert not violations(page)
    row.get_by_role("link", name="-scan").first.click()
    expect(page.get_by_role("region", name="List of marks")).to_contain_text("READY to RUN")
    assert not violations(page)
