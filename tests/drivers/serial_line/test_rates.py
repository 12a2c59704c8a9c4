from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.gcs.dialogue import GcsDialogue
from piezod_drivers.serial_line.pi_gcs1.dialogue import Gcs1Dialogue
from piezod_drivers.serial_line.pi_gcs1.emulator import EMULATOR as E816
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options
from piezod_drivers.serial_line.pi_gcs2.dialogue import Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.emulator import EMULATOR as E727
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options
from piezod_drivers.serial_line.thorlabs_mdt.dialogue import MdtDialogue
from piezod_drivers.serial_line.thorlabs_mdt.emulator import MDT693B, MDT694B
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

PAGE = Path(__file__).parents[3] / "docs" / "serial.md"
DRIVEN_V = 100.1234


def gcs2_of(line: EmulatedLine, names: str) -> Any:
    """Return the conversation with an E-727."""
    return Gcs2Dialogue(line, Gcs2Options(port="x"), Wiring.both(names))


def gcs1_of(line: EmulatedLine, names: str) -> Any:
    """Return the conversation with an E-816."""
    return Gcs1Dialogue(line, Gcs1Options(port="x"), Wiring.both(names))


def mdt_of(line: EmulatedLine, names: str) -> Any:
    """Return the conversation with an MDT."""
    return MdtDialogue(line, 0.1, Wiring((), tuple(names)))


@pytest.mark.parametrize(
    ("plugin", "dialogue_of", "names", "row"),
    [
        (E727, gcs2_of, "1", "| `pi_gcs2` |"),
        (E727, gcs2_of, "12", "| `pi_gcs2` |"),
        (E727, gcs2_of, "123", "| `pi_gcs2` |"),
        (E816, gcs1_of, "A", "| `pi_gcs1` |"),
        (E816, gcs1_of, "AB", "| `pi_gcs1` |"),
        (MDT694B, mdt_of, "x", "| `thorlabs_mdt`, one output |"),
        (MDT693B, mdt_of, "xyz", "| `thorlabs_mdt`, MDT693B |"),
    ],
)
def test_the_table_of_rates(
    plugin: Any, dialogue_of: Callable[[EmulatedLine, str], Any], names: str, row: str
) -> None:
    """The page's bytes and rates are those of a cycle of driver and emulated device."""
    table, _, time = bench(len(names))
    line = EmulatedLine(plugin.create(table, ""), time)
    dialogue = dialogue_of(line, names)
    dialogue.open()
    line.sent.clear()
    back: list[bytes] = []

    def noted(reply: bytes) -> bytes:
        back.append(reply)
        return reply

    line.change = noted
    if isinstance(dialogue, GcsDialogue):
        dialogue.exchange([DRIVEN_V] * len(names), 1)
    else:
        dialogue.put([DRIVEN_V] * len(names))
    dialogue.in_force(1)
    n_sent, n_back = (sum(map(len, parts)) for parts in (line.sent, back))
    cells = f" {len(names)} | {n_sent} + {n_back} | {len(line.sent)} | "
    rate_hz = 115_200 / 10 / (n_sent + n_back)
    assert f"{row}{cells}{rate_hz:.0f} Hz" in PAGE.read_text(encoding="utf-8")
