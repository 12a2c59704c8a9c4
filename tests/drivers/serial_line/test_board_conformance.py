"""The conformance script for boards: it passes on our firmware, and fails on one with a mistake."""

import shutil
from pathlib import Path
from typing import Final

import pytest

from piezod_drivers.serial_line.piezo_board.emulation.build import build, sources
from piezod_drivers.serial_line.piezo_board.emulator import BoardEmulator
from tests.drivers.serial_line.board_conformance import EmulatedPort, script
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.linear_rig import bench

pytestmark = needs_board
GUARD: Final = """if (player_state() != PLAYER_ON)
        return player_state() == PLAYER_OFF ? OFF : BUSY;
    if (!fits"""
MISTAKES: Final = {
    "data are taken whatever their checksum": ("line.c", "if (data.crc) {", "if (0) {"),
    "a line is taken whatever its checksum": (
        "line.c",
        " || found != crc",
        " || (found != crc && 0)",
    ),
    "half of the data is waited for without end": (
        "line.c",
        "++data.silent_ms > SILENT_MS",
        "data.silent_ms > SILENT_MS",
    ),
    "the tag is not repeated": ("line.c", "    reply_text(tag);\n", ""),
    "setpoints are taken while it is off": (
        "commands.c",
        GUARD,
        "if (player_state() == PLAYER_PLAYING)\n        return BUSY;\n    if (!fits",
    ),
    "setpoints are taken during a play": (
        "commands.c",
        GUARD,
        "if (player_state() == PLAYER_OFF)\n        return OFF;\n    if (!fits",
    ),
    "a setpoint beyond 16 bits is cut off": ("commands.c", "!fits || ", "(!fits && 0) || "),
    "a table is played without a comparison": (
        "commands.c",
        "if (play_crc(plan.lead + plan.period) != crc)",
        "if (0)",
    ),
    "a play has a cycle too many": ("play.c", "now.cycle + 1 == plan", "now.cycle == plan"),
    "a record begins a point late": (
        "play.c",
        "now.until_record = plan.first;",
        "now.until_record = plan.first + 1;",
    ),
    "a stop goes back to where the play began": ("player.c", "    play_last(out, in);\n}", "}"),
    "the watchdog sleeps during a play": (
        "player.c",
        "player_state() != PLAYER_OFF && watchdog_ms",
        "player_state() == PLAYER_ON && watchdog_ms",
    ),
    "nothing leads to the safe value": ("player.c", "if (from != to) {", "if (from != to && 0) {"),
}
"""File of the core, its text, and the text with the mistake."""
QUICK: Final = {"a record begins a point late", "nothing leads to the safe value"}


def port(folder: Path | None) -> EmulatedPort:
    """Return the line to a board with piezod's firmware, or with that of a folder."""
    rig, _, time = bench()
    return EmulatedPort(BoardEmulator(rig, "", build(folder)), time)


def test_our_firmware_conforms() -> None:
    """Every check passes."""
    assert script().failures(port(None)) == []


@pytest.mark.parametrize(
    "mistake",
    [pytest.param(each, marks=[] if each in QUICK else pytest.mark.stress) for each in MISTAKES],
)
def test_a_mistake_is_found(mistake: str, tmp_path: Path) -> None:
    """A firmware with one mistake fails a check."""
    name, right, wrong = MISTAKES[mistake]
    folder = tmp_path / "player"
    shutil.copytree(sources(), folder)
    file = folder / "core" / name
    text = file.read_text(encoding="utf-8")
    assert text.count(right) == 1
    file.write_text(text.replace(right, wrong), encoding="utf-8")
    assert script().failures(port(folder)) != []
