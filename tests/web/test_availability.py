"""The page's table of the states in which a command can be used, against the state machine."""

import json
import re
from pathlib import Path

import pytest

import piezod.web
from piezod.config.states import State
from piezod.control.stage.states import Event, step
from tests.control.stage.test_states import GOOD

EVENTS = {
    "arm": Event.ARM,
    "hold": Event.HOLD,
    "resume": Event.RESUME,
    "reset": Event.RESET,
    "condition": Event.IDENTIFY,
    "goto": Event.RUN_ADAPTIVE,
    "wave": Event.RUN_ADAPTIVE,
}


def states_of_the_page() -> dict[str, list[str]]:
    """Return the table `STATES` of the page."""
    file = Path(piezod.web.__file__).parent / "static" / "availability.js"
    found = re.search(r"^const STATES = (\{.*?^\});", file.read_text(), re.DOTALL | re.MULTILINE)
    assert found
    table: dict[str, list[str]] = json.loads(found[1])
    return table


@pytest.mark.parametrize("command", EVENTS)
def test_command_is_barred_where_the_stage_refuses_it(command: str) -> None:
    """The page offers a command in just the states in which a healthy stage accepts it."""
    accepted = {state for state in State if not step(state, EVENTS[command], GOOD).refusal}
    if command == "arm":
        accepted -= {State.READY, State.RUN}  # armed already: nothing changes

    assert set(states_of_the_page()[command]) == accepted


def test_mode_and_zero_are_offered_where_the_stage_takes_them() -> None:
    """A mode can be chosen before the stage is armed, and a sensor zeroed at rest only."""
    table = states_of_the_page()
    assert set(table["mode"]) == {"SAFE", *table["goto"]}
    assert set(table["zero"]) == {"SAFE", "READY"}
    assert table.keys() == EVENTS.keys() | {"mode", "zero"}
