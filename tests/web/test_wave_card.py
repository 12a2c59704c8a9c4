"""The waveforms of the page, against those of the command line and of the records."""

import re
from pathlib import Path

import piezod.web
from piezod.config.waveforms.swings import SWINGS

CARD = (Path(piezod.web.__file__).parent / "static" / "wave_card.js").read_text()


def table(name: str) -> str:
    """Return the text of a table of the page."""
    found = re.search(rf"^const {name} = \{{(.*?)^\}};", CARD, re.DOTALL | re.MULTILINE)
    assert found
    return found[1]


def test_the_page_has_every_swing_and_its_numbers() -> None:
    """A swing that can be set elsewhere can be set on the page, with the same numbers."""
    keys = {number.key for numbers in SWINGS.values() for number in numbers}

    assert re.findall(r"^  (\w+): ", table("KINDS"), re.MULTILINE) == list(SWINGS)
    assert set(re.findall(r"(\w+): \[", table("NUMBERS"))) == keys | {"duration_s"}
