"""Programs for PI controllers get the replies that they expect."""

import pytest

from tests.gcs import dialogues
from tests.gcs.fake_stage import Controller, Dialogue
from tests.gcs_tables import PAGE, page


@pytest.mark.parametrize("program", dialogues.PROGRAMS)
def test_program(controller: Controller, client: Dialogue, program: str) -> None:
    """Each request has the reply that the program expects, and the program moves the stage."""
    for request, reply in dialogues.PROGRAMS[program]:
        line = request if len(request) == 1 else f"{request}\n"
        received = client.send(line.encode("latin-1")).decode("cp1252").removesuffix("\n")
        assert received if reply is None else (request, received) == (request, reply)

    assert controller.stage.do("goto")[0]["axis"] == "x"
    assert controller.stage.paths()[-2:] == ["hold", "resume"]


def test_page_has_the_commands_of_each_program() -> None:
    """The table of the page has what the dialogues send."""
    assert PAGE.read_text(encoding="utf-8") == page()
