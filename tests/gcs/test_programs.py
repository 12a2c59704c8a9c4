"""Programs for PI controllers get the replies that they expect."""

import pytest

from tests.gcs import dialogues
from tests.gcs.fake_stage import Controller, Dialogue


@pytest.mark.parametrize("program", dialogues.PROGRAMS)
def test_program(controller: Controller, client: Dialogue, program: str) -> None:
    """Each request has the reply that the program expects, and the program moves the stage."""
    for request, reply in dialogues.PROGRAMS[program]:
        line = request if len(request) == 1 else f"{request}\n"
        received = client.send(line.encode("latin-1")).decode("cp1252").removesuffix("\n")
        assert received if reply is None else (request, received) == (request, reply)

    assert controller.stage.do("goto")[0]["axis"] == "x"
    assert controller.stage.paths()[-2:] == ["hold", "resume"]
