"""Commands to a stage that is served as a GCS controller."""

import pytest

from piezod.errors import NotAllowedError, RefusedError
from tests.gcs.fake_stage import Controller, Dialogue

ALL_STOPS = [b"\x18", b"STP\n", b"STP 1\n", b"HLT\n", b"HLT 1\n"]


def test_servo_on_arms_and_selects_the_mode(controller: Controller, client: Dialogue) -> None:
    """`SVO 1` arms, then the axis follows in the mode of the server; the other axis does not."""
    assert client.error_of("SVO 1 1") == 0

    assert controller.stage.paths() == ["arm", "mode"]
    assert controller.stage.do("mode") == [{"mode": "trimmed", "axis": "x"}]
    assert client.ask("SVO?") == "1=1 \n2=0\n"
    assert client.error_of("SVO 1 1") == 0
    assert controller.stage.paths() == ["arm", "mode"]


def test_servo_on_while_the_stage_is_conditioned(
    controller: Controller, client: Dialogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If arming conditions the stage, `SVO 1` is refused until `#7` reports ready again."""
    monkeypatch.setattr(
        controller.stage, "_arm", lambda _: setattr(controller.stage, "state", "IDENT")
    )
    assert client.error_of("SVO 1 1") == 63
    assert client.ask("\x07") == "\xb0\n"
    assert client.error_of("SVO 1 1") == 63
    assert controller.stage.paths() == ["arm"]

    monkeypatch.undo()
    with controller.changing() as stage:
        stage.state = "READY"
    assert client.ask("\x07") == "\xb1\n"
    assert client.error_of("SVO 1 1") == 0
    assert client.ask("SVO? 1") == "1=1\n"


def test_move_without_servo(controller: Controller, client: Dialogue) -> None:
    """A move with the servo off is refused, also after another client has changed the mode."""
    assert client.error_of("MOV 1 5") == 5
    assert client.error_of("SVO 1 1") == 0
    with controller.changing() as stage:
        stage.axes["x"]["mode"] = "uncompensated"
    assert client.error_of("MOV 1 5") == 5
    assert client.ask("SVO? 1") == "1=0\n"
    assert controller.stage.do("goto") == []


def test_moves(controller: Controller, armed: Dialogue) -> None:
    """`MOV` moves to positions, `MVR` relative to the targets, at the speed of `VEL`."""
    assert armed.error_of("MOV 1 5 2 7.25") == 0
    assert armed.error_of("VEL 2 50") == 0
    assert armed.error_of("MVR 2 -1e-1") == 0

    assert armed.ask("MOV?") == "1=5.000000 \n2=7.150000\n"
    assert armed.ask("VEL?") == "1=100.000000 \n2=50.000000\n"
    assert controller.stage.do("goto") == [
        {"position_um": 5.0, "axis": "x"},
        {"position_um": 7.25, "axis": "y"},
        {"position_um": 7.15, "axis": "y", "speed_um_per_s": 50.0},
    ]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("MOV 1 20.001", 7),
        ("MOV 2 5 1 -0.001", 7),
        ("MVR 1 19", 7),
        ("VEL 1 101", 8),
        ("VEL 1 0", 8),
        ("VEL 1 -5", 8),
    ],
)
def test_limits(controller: Controller, armed: Dialogue, line: str, code: int) -> None:
    """If one value is out of its limits, nothing moves and no speed changes."""
    assert armed.error_of(line) == code

    assert controller.stage.do("goto") == []
    assert armed.ask("VEL? 1") == "1=100.000000\n"


def test_motion_and_on_target(controller: Controller, armed: Dialogue) -> None:
    """An axis moves until it is on target, in the bit mask and in the register."""
    assert armed.error_of("MOV 2 5") == 0
    with controller.changing() as stage:
        stage.axes["x"]["on_target"] = True
    assert armed.ask("\x05") == "2\n"
    assert armed.ask("ONT?") == "1=1 \n2=0\n"
    assert armed.ask("SRG? 1 1") == "1 1=0x9000\n"
    assert armed.ask("SRG? 2 1") == "2 1=0x3000\n"

    with controller.changing() as stage:
        stage.axes["y"]["on_target"] = True
    assert armed.ask("\x05") == "0\n"


def test_axis_without_a_sensor(controller: Controller, armed: Dialogue) -> None:
    """Its position is its command, and it has arrived when its command has."""
    blind = {"has_sensor": False, "position_um": None, "on_target": False}
    with controller.changing() as stage:
        stage.axes["x"].update(blind, command_um=4.0, target_um=5.0)
        stage.axes["y"].update(blind, command_um=2.0, target_um=2.0)
    assert armed.ask("\x05") == "1\n"
    assert armed.ask("ONT?") == "1=0 \n2=1\n"
    assert armed.ask("POS?") == "1=4.000000 \n2=2.000000\n"
    assert armed.ask("SRG? 2 1") == "2 1=0x9000\n"

    with controller.changing() as stage:
        stage.axes["x"].update(command_um=None, target_um=None)
    assert armed.error_of("POS? 1") == 505


@pytest.mark.parametrize("stop", ALL_STOPS)
def test_stop_of_the_client_that_moves(
    controller: Controller, armed: Dialogue, stop: bytes
) -> None:
    """The voltage is held at once, then the servo is on again, and the next move is accepted."""
    assert armed.error_of("MOV 1 5") == 0
    controller.stage.requests.clear()

    assert armed.send(stop) == b""

    assert armed.ask("ERR?") == "10\n"
    assert controller.stage.paths() == ["hold", "resume"]
    assert armed.ask("SVO? 1") == "1=1\n"
    assert armed.error_of("MOV 1 6") == 0


@pytest.mark.parametrize("stop", ALL_STOPS)
def test_stop_of_another_client(controller: Controller, armed: Dialogue, stop: bytes) -> None:
    """The stage stays in HOLD until `SVO 1`."""
    other = controller.client("gcs:2")
    controller.stage.requests.clear()

    assert other.send(stop) == b""

    assert other.ask("ERR?") == "10\n"
    assert armed.ask("ERR?") == "0\n"
    assert controller.stage.paths() == ["hold"]
    assert armed.error_of("MOV 1 6") == 5
    assert armed.error_of("SVO 1 1") == 0
    assert controller.stage.paths() == ["hold", "resume"]


def test_servo_off_holds(controller: Controller, armed: Dialogue) -> None:
    """`SVO 0` holds the voltage and moves nothing; a stop afterwards does not resume."""
    controller.stage.requests.clear()

    assert armed.error_of("SVO 1 0") == 0
    assert armed.ask("SVO?") == "1=0 \n2=0\n"
    assert armed.error_of("STP") == 10

    assert controller.stage.paths() == ["hold", "hold"]
    assert armed.error_of("MOV 1 5") == 5


def test_stop_at_once_after_servo_off(controller: Controller, armed: Dialogue) -> None:
    """The stop does not switch the servo on again, also without a query in between."""
    armed.send(b"SVO 1 0\n\x18")

    assert controller.stage.state == "HOLD"
    assert armed.ask("SVO? 1") == "1=0\n"


def test_servo_off_and_stop_of_a_disarmed_stage(controller: Controller, client: Dialogue) -> None:
    """`SVO 0` is no error, and a stop of nothing is a stop."""
    assert client.error_of("SVO 1 0 2 0") == 0
    assert client.error_of("STP") == 10

    assert controller.stage.state == "SAFE"


def test_stop_does_not_resume_a_stage_that_a_fault_holds(
    controller: Controller, armed: Dialogue
) -> None:
    """A stage in HOLD stays there."""
    with controller.changing() as stage:
        stage.state = "HOLD"
    assert armed.ask("SVO? 1") == "1=0\n"

    assert armed.error_of("STP") == 10
    assert controller.stage.state == "HOLD"


def test_stop_that_the_daemon_did_not_carry_out(controller: Controller, armed: Dialogue) -> None:
    """The error is not "stopped"."""
    controller.stage.errors = {"hold": RefusedError("there is no loop", "", "unavailable")}

    assert armed.error_of("STP") == 215


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (RefusedError("somebody holds the lease", "", "lease_held"), 733),
        (RefusedError("cannot arm in FAULT", "", "refused"), 34),
        (NotAllowedError("needs the role operator", "", "forbidden"), 60),
    ],
)
def test_refusal_of_the_daemon(
    controller: Controller, client: Dialogue, error: RefusedError, code: int
) -> None:
    """The client gets a number, and the reason is reported in words."""
    controller.stage.errors = {"arm": error}

    assert client.error_of("SVO 1 1") == code
    assert error.what in client.reports[-1]
    assert client.ask("POS? 1") == "1=1.500000\n"


def test_lease_ends_with_the_connection(controller: Controller, armed: Dialogue) -> None:
    """A connection that has commanded releases its lease, one that has read requests nothing."""
    reader = controller.client("gcs:2")
    reader.ask("POS?")
    controller.stage.requests.clear()

    reader.close()
    assert controller.stage.requests == []
    armed.close()
    assert [(client, path) for client, path, _ in controller.stage.requests] == [("gcs:1", "lease")]


def test_too_many_requests_are_sent_again(
    controller: Controller, armed: Dialogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A request beyond the daemon's limit of rate is late, and not lost."""
    answer, refusals = controller.stage.answer, iter([True, True])

    def limited(client: str, path: str, body: dict[str, object]) -> dict[str, object]:
        if path == "goto" and next(refusals, False):
            raise RefusedError("too many requests", "", "too_many")
        return answer(client, path, body)

    monkeypatch.setattr(controller.stage, "answer", limited)

    assert armed.error_of("MOV 1 5") == 0
    assert controller.stage.do("goto") == [{"position_um": 5.0, "axis": "x"}]


@pytest.mark.parametrize("stop", ALL_STOPS)
def test_stop_overtakes_what_waits(controller: Controller, armed: Dialogue, stop: bytes) -> None:
    """Movements before it that have not begun are dropped; queries keep their order."""
    held = controller.held("goto")
    moves = b"".join(b"MOV 1 %d 2 %d\n" % (um, um) for um in range(1, 9))
    controller.stage.requests.clear()

    rest = b"ERR?\n" + stop + b"ERR?\nMOV 1 12\nERR?\n"
    replies = armed.send_meanwhile(moves, rest, held)

    # The first one is on its way to the daemon: it is refused, or held.
    assert controller.stage.paths() == ["hold", "goto", "resume", "goto"]
    assert controller.stage.do("goto")[-1] == {"position_um": 12.0, "axis": "x"}
    assert replies == b"10\n10\n0\n"


def test_closed_connection_moves_nothing(controller: Controller, armed: Dialogue) -> None:
    """Commands that wait when the client leaves are dropped."""
    held = controller.held("goto")
    controller.stage.requests.clear()

    armed.leave(b"MOV 1 1 2 1\nMOV 1 2\nSVO 2 1\nMOV 2 3\n", held)

    assert controller.stage.paths() == ["lease"]


def test_stop_of_a_client_that_leaves_is_carried_out(
    controller: Controller, armed: Dialogue
) -> None:
    """To its end: the stage is held, and follows the next movement."""
    held = controller.held("hold")
    controller.stage.requests.clear()

    armed.leave(b"\x18MOV 1 1\n", held)

    assert controller.stage.paths() == ["hold", "resume", "lease"]


def test_servo_that_waits_is_not_switched_on_after_a_stop(
    controller: Controller, armed: Dialogue
) -> None:
    """Arming could condition the stage, which moves it; switching off is carried out."""
    held = controller.held("goto")
    armed.send_meanwhile(b"MOV 1 1\n", b"SVO 1 0\nSVO 1 1\nMOV 1 2\n\x18", held)

    assert controller.stage.state == "HOLD"


def test_client_that_floods_the_controller_is_closed(client: Dialogue) -> None:
    """Commands that wait are kept in memory: there is a limit."""
    with pytest.raises(ConnectionAbortedError, match="wait for their turn"):
        client.send(b"POS?\n" * 5000)
