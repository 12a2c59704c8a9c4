"""The page of a stage: its controls, their refusals, and what it does while nobody looks."""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from piezod.messages.answers import AXIS, STAGE
from piezod.messages.shown import DETAIL
from tests.browser.machine import Machine
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.browser

HIDE = """hidden => {
    Object.defineProperty(document, "hidden", {value: hidden, configurable: true});
    document.dispatchEvent(new Event("visibilitychange"));
}"""

INKED = """figure => {
    const canvas = figure.querySelector("canvas");
    if (!canvas || !canvas.width) return 0;
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const ink = getComputedStyle(document.documentElement).getPropertyValue("--position").trim();
    const wanted = [1, 3, 5].map((at) => parseInt(ink.slice(at, at + 2), 16));
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
        count += data[i + 3] > 200 && wanted.every((each, k) => Math.abs(each - data[i + k]) < 8);
    }
    return count;
}"""
"""Returns how many pixels of a chart have the colour of the displacement."""


def test_refusal_stands_beside_its_control(page: Page) -> None:
    """The card of a control shows what was refused and what helps, until a request is accepted."""
    stage, position = (
        page.get_by_role("region", name=name, exact=True) for name in ("Stage", "Position")
    )
    refusal = position.get_by_role("status")
    stage.get_by_role("button", name="Arm", exact=True).click()
    position.get_by_label("Position").fill("99")
    position.get_by_role("button", name="Go").click()
    expect(refusal).to_contain_text("out of range")
    expect(stage.get_by_role("status")).to_be_empty()

    position.get_by_label("Position").fill("3")
    position.get_by_role("button", name="Go").click()

    expect(refusal).to_be_empty()


def test_wave_outside_the_range_is_not_started(page: Page) -> None:
    """A wave beyond the range of commands is named with the limits before it can be sent."""
    page.get_by_role("button", name="Arm", exact=True).click()
    wave = page.get_by_role("region", name="Waveform")
    start = wave.get_by_role("button", name="Start the wave")
    expect(start).to_be_enabled()
    wave.get_by_label("High").fill("30")
    expect(wave).to_contain_text("2 to 30 µm, allowed 0 to 26 µm")
    expect(start).to_be_disabled()

    wave.get_by_label("High").fill("2")
    expect(wave).to_contain_text("Low must be below high")
    expect(start).to_be_disabled()

    wave.get_by_label("High").fill("20")
    expect(wave).to_contain_text("largest speed 56.5 µm/s")
    expect(start).to_be_enabled()


def test_displacement_is_drawn_against_drive_and_against_command(page: Page) -> None:
    """Two charts side by side: the loop of the hysteresis, and the compensated line."""
    loop, line = (
        page.locator("figure").filter(has=page.get_by_text(f"Position against {name}"))
        for name in ("drive", "command")
    )
    loop.scroll_into_view_if_needed()
    expect(line).to_contain_text("nothing is commanded")
    assert line.evaluate(INKED) == 0

    page.get_by_role("button", name="Arm", exact=True).click()
    page.get_by_role("button", name="Start the wave").click()
    expect(page.locator("#state")).to_contain_text("RUN")
    line.scroll_into_view_if_needed()

    eventually(lambda: all(each.evaluate(INKED) > 100 for each in (loop, line)), 20.0)
    expect(line).not_to_contain_text("nothing is commanded")
    left, right = loop.bounding_box(), line.bounding_box()
    assert left is not None
    assert right is not None
    assert (left["y"], left["x"] < right["x"]) == (right["y"], True)


def test_slider_drags_the_set_point(page: Page, machine: Machine) -> None:
    """The stage is where the slider was released, whatever happened on the way."""
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(page.locator("#state")).to_contain_text("READY")
    slider = page.get_by_role("slider", name="Set-point")
    box = slider.bounding_box()
    assert box is not None
    middle_px = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 10, middle_px)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, middle_px, steps=25)
    page.mouse.up()
    wanted_um = float(slider.input_value())

    def target_um() -> float | None:
        target: float | None = status_of(machine)["axes"]["x"]["target_um"]
        return target

    eventually(lambda: target_um() == wanted_um, 10.0)
    assert 12.0 < wanted_um < 14.0


def test_hidden_tab_gets_no_telemetry(page: Page) -> None:
    """A tab that is hidden ends its telemetry, and asks for it again when it is seen."""
    position = page.locator(".readout", has_text="position").locator(".value")
    expect(position).to_have_text(re.compile(r"\d"))
    with page.expect_websocket() as opened:
        page.reload()
    expect(position).to_have_text(re.compile(r"\d"))
    with opened.value.expect_event("framesent", is_message("unwatch")):
        page.evaluate(HIDE, True)
    with opened.value.expect_event("framesent", is_message("watch")):
        page.evaluate(HIDE, False)


def test_theme_is_kept(page: Page) -> None:
    """The theme that a person has chosen outlives the page."""
    theme = page.get_by_role("button", name="Dark")
    expect(theme).to_have_attribute("aria-pressed", "false")
    theme.click()
    page.reload()
    expect(theme).to_have_attribute("aria-pressed", "true")
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")


def is_message(do: str) -> Callable[[str], bool]:
    """Return a predicate for the texts of a WebSocket: messages of one kind."""
    return lambda text: bool(json.loads(text)["do"] == do)


def status_of(machine: Machine) -> dict[str, Any]:
    """Return the status of the stage."""
    document: dict[str, Any] = json.loads(machine.run("status", "--json"))
    return document


def test_details_are_what_the_messages_describe(page: Page) -> None:
    """Each field that is a detail has a row with its words; a number has its unit."""
    details = page.get_by_role("region", name="Details")
    for field in (*AXIS.values(), *STAGE.values()):
        if field.has(DETAIL):
            expect(details.locator("dt", has_text=field.shown.words).first).to_be_visible()
    expect(details.locator("dd", has_text=re.compile(r"^[\d.]+ Hz$"))).to_be_visible()
