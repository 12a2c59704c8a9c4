"""Requests of the supervisor to the loop."""

import asyncio
import time
from pathlib import Path

import pytest

from piezod.config.waveforms.paths import Reversals
from piezod.control.stage.answer import Answer
from piezod.daemon.stage.connection import LoopRequests
from piezod.daemon.stage.errors import BadValueError, NoAnswerError, UnavailableError
from piezod.messages.requests import Estop, Goto, Hold, Request, Wave
from piezod.telemetry.layout import REQUEST_SLOTS, URGENT_SLOTS, Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S
from tests.daemon.fake_loop import FakeLoop


@pytest.fixture
def shared(tmp_path: Path) -> SharedMap:
    """Return the memory shared with a loop."""
    return create(tmp_path / "loop.map", Layout(("x",), 64, 1_000_000))


def _ask(requests: LoopRequests, request: Request) -> Answer:
    return asyncio.run(requests.ask(request))


@pytest.mark.parametrize("answer", [Answer(True, "", 3, 1.5), Answer(False, "cannot move in SAFE")])
def test_answer_of_the_loop_is_given_back(shared: SharedMap, answer: Answer) -> None:
    """The answer arrives unchanged, with its reason."""
    with FakeLoop(shared, answer) as loop:
        found = _ask(LoopRequests(shared), Goto(position_um=3.0))

    assert found == answer
    assert loop.requests == [Goto(position_um=3.0)]


def test_request_that_the_loop_does_not_take_expires(shared: SharedMap) -> None:
    """The error says whether the loop has started; the request is not executed later."""
    requests = LoopRequests(shared)

    with pytest.raises(NoAnswerError, match="the loop is starting"):
        _ask(requests, Goto(position_um=3.0))
    shared.words[Word.LOOP_BEAT_NS] = 1
    with pytest.raises(NoAnswerError, match=r"within 0\.5 s"):
        _ask(requests, Goto(position_um=3.0))
    with FakeLoop(shared) as loop:
        _ask(requests, Hold())

    assert loop.requests == [Hold()]


def test_waveform_that_would_stall_the_loop_is_refused(shared: SharedMap) -> None:
    """A few bytes can ask for millions of turning points. The loop never sees such a request."""
    tiny = Reversals(
        kind="reversals", low=0.0, high=1e-3, min_swing=1e-3, min_speed=0.2, max_speed=0.2, seed=1
    )
    wave = Wave(command_um={"x": tiny}, duration_s=86_400.0)

    with pytest.raises(BadValueError, match="too many points, allowed: at most"):
        _ask(LoopRequests(shared), wave)
    assert shared.words[Word.REQUESTS_POSTED] == 0


@pytest.mark.fault("E1")
def test_emergency_stop_is_never_refused(shared: SharedMap) -> None:
    """An emergency stop has room even if the urgent lane is full."""
    requests, later_ns = LoopRequests(shared), time.monotonic_ns() + 60 * NS_PER_S
    for _ in range(URGENT_SLOTS):
        requests.post(Hold(), later_ns)

    with pytest.raises(UnavailableError, match="4 requests wait"):
        _ask(requests, Hold())

    async def posted_before_the_loop_looks() -> tuple[Answer, list[Request]]:
        asked = asyncio.create_task(requests.ask(Estop()))
        await asyncio.sleep(0)
        with FakeLoop(shared) as loop:
            return await asked, loop.requests

    answer, taken = asyncio.run(posted_before_the_loop_looks())

    assert answer.accepted
    assert taken[0] == Estop()


@pytest.mark.fault("E1")
def test_emergency_stop_does_not_expire(shared: SharedMap) -> None:
    """The client gets no answer in time, and the stop is executed as soon as possible."""
    requests = LoopRequests(shared)

    with pytest.raises(NoAnswerError):
        _ask(requests, Estop())
    with FakeLoop(shared) as loop:
        _ask(requests, Hold())

    assert loop.requests == [Estop(), Hold()]


def test_full_mailbox_is_an_error_at_once(shared: SharedMap) -> None:
    """Requests to a loop that takes none do not pile up; a hold still gets through."""
    requests, later_ns = LoopRequests(shared), time.monotonic_ns() + 60 * NS_PER_S
    for _ in range(REQUEST_SLOTS):
        requests.post(Goto(position_um=3.0), later_ns)

    with pytest.raises(UnavailableError, match="16 requests wait"):
        _ask(requests, Goto(position_um=3.0))
    with FakeLoop(shared):
        assert _ask(requests, Hold()).accepted
