"""The response of a running stage: its setup, and what is refused before anything moves."""

import pytest

from piezod.config.response_file import ResponseFile
from piezod.errors import DataError
from piezod.experiment.live.response import response_live
from piezod.experiment.live.setup import read_setup
from piezod.experiment.response.plan import Wanted
from tests.config.test_response_file import RESPONSE
from tests.experiment.live_fakes import FakeStage, stage_document


def test_client_knows_the_response_of_the_stage() -> None:
    """The daemon reports the contents of the file, so that a client needs no access to it."""
    document = stage_document(response=RESPONSE.model_dump(mode="json", exclude_none=True))
    del document["axes"]["x"]["first_mode"]

    config = read_setup(FakeStage(document)).axes["x"].config

    assert isinstance(config.response, ResponseFile)
    assert config.response == RESPONSE
    assert config.first_mode is not None
    assert config.first_mode.frequency_hz == pytest.approx(800.333, abs=0.001)


@pytest.mark.parametrize(
    ("axis", "wanted", "why"),
    [
        ("y", Wanted(), "stage fake has no axis y; its axes are x"),
        (None, Wanted((200.0,)), "axis x: an offset of 200 V leaves no room"),
        (None, Wanted(high_hz=600.0), "axis x: 600 Hz cannot be measured at 1000 Hz"),
    ],
)
def test_what_is_refused_moves_nothing(axis: str | None, wanted: Wanted, why: str) -> None:
    """The plan is checked before the first request that drives."""
    stage = FakeStage()

    with pytest.raises(DataError, match=why):
        response_live(stage, axis, wanted, lambda _label, _share: None)

    assert not {"arm", "identify", "session"} & set(stage.asked)
