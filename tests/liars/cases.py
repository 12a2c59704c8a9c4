"""What a stage does while its amplifier begins to lie."""

import time
from collections.abc import Callable
from math import pi, sin
from typing import Final, NamedTuple

from tests.daemon.waiting import eventually
from tests.liars.bench import Bench
from tests.liars.process import Speaks

LASTS_S: Final = 4.5
"""Longer than the HOLD before a ramp, and some of the ramp."""
LONG_S: Final = 38.0
"""Longer than a ramp waits for its output."""
KNOB_V: Final = 40.0
WAVE: Final = {"kind": "sine", "low": 1.0, "high": 16.0, "frequency_hz": 0.4}
IDENT: Final = {"kind": "sine", "low": 0.0, "high": 80.0, "frequency_hz": 0.4}
INTERVAL_S: Final = 0.005
POINTS: Final = 400
TABLE: Final = [50.0 + 30.0 * sin(2.0 * pi * i / POINTS) for i in range(POINTS)]
"""One period of a table, in V: at most 94 V/s."""
ENDS_S: Final = 0.4
"""Time before the end of a play, in s."""


class Case(NamedTuple):
    """A state or verb."""

    prepare: Callable[[Bench], None]  #: Brings an honest stage to where the lie begins.
    act: Callable[[Bench], None]  #: What a person does just after the lie has begun.
    lasts_s: float = LASTS_S  #: How long the lie lasts, in s.
    speaks: Speaks = "lines"  #: How the amplifier speaks: a play needs one that plays tables.


def _nothing(_bench: Bench) -> None:
    """Do nothing."""


def _knob(bench: Bench) -> None:
    bench.amplifier.tell(f"knob {KNOB_V}")
    bench.rest(0.5)


def _ready(bench: Bench) -> None:
    _knob(bench)
    bench.armed()
    bench.until(lambda status: status.get("state") == "READY")


def _arm_and_go(bench: Bench) -> None:
    bench.rest(0.3)
    if bench.ask("arm"):
        bench.ask("goto", position_um=14.0)


def _go_on(bench: Bench) -> None:
    bench.rest(0.3)
    bench.ask("goto", position_um=14.0)


def _there(bench: Bench) -> None:
    bench.armed()
    bench.ask("goto", position_um=14.0)
    bench.driven(60.0)
    bench.rest(0.5)


def _going(bench: Bench) -> None:
    bench.armed()
    bench.ask("goto", position_um=20.0, speed_um_per_s=6.0)
    bench.driven(30.0)


def _waving(bench: Bench) -> None:
    bench.armed()
    bench.ask("wave", command_um={"x": WAVE}, duration_s=600.0)
    bench.driven(40.0)


def _conditioning(bench: Bench) -> None:
    bench.armed()
    bench.ask("condition")
    bench.driven(30.0)


def _identifying(bench: Bench) -> None:
    bench.armed()
    bench.ask("identify", drive_v={"x": IDENT}, duration_s=600.0)
    bench.driven(40.0)


def _held(bench: Bench) -> None:
    _there(bench)
    bench.ask("hold")


def _ramping(bench: Bench) -> None:
    _there(bench)
    bench.ask("stop")
    eventually(lambda: bench.amplifier.output_v() < 50.0)


def _asks(verb: str) -> Callable[[Bench], None]:
    def ask(bench: Bench) -> None:
        bench.ask(verb)

    return ask


def _kill_loop(bench: Bench) -> None:
    bench.kill_loop()
    bench.daemon_ends()


def _kill_all_and_safe(bench: Bench) -> None:
    bench.kill_all()
    bench.beside("safe", str(bench.config))


def _kill_all_and_restart(bench: Bench) -> None:
    bench.kill_all()
    bench.start()
    bench.until(lambda status: status.get("state") in {"SAFE", "FAULT"}, 60.0)
    _arm_and_go(bench)


def _kill_all_and_commission(bench: Bench) -> None:
    bench.kill_all()
    bench.beside("commission", "--yes", str(bench.config))


def _kill_commission_and_safe(bench: Bench) -> None:
    bench.kill_beside()
    bench.beside("safe", str(bench.config))


def _kill_commission_and_repeat(bench: Bench) -> None:
    bench.kill_beside()
    bench.beside("commission", "--yes", str(bench.config))


def _kill_commission_and_arm(bench: Bench) -> None:
    bench.kill_beside()
    bench.start()
    bench.until(lambda status: status.get("state") in {"SAFE", "FAULT"}, 60.0)
    _arm_and_go(bench)


def _commissioning(bench: Bench) -> None:
    bench.shut_down()
    # A person has seen the honest output; the case before may have left it unlike its last write.
    bench.beside("commission", "--yes", "--confirm-output", str(bench.config))
    bench.driven(10.0)


def _play(bench: Bench, periods: int = 5) -> None:
    """Let it play some periods, each of 2 s."""
    bench.ask("play", drive_v=TABLE, interval_s=INTERVAL_S, cycles=periods)


def _go_on_by_play(bench: Bench) -> None:
    bench.rest(0.3)
    _play(bench)


def _loading(bench: Bench) -> None:
    """Begin to load a table of 200 messages."""
    bench.armed()
    bench.ask("play", drive_v=TABLE * 10, interval_s=INTERVAL_S, cycles=1)
    eventually(lambda: bench.traced("load"), 12.0)


def _playing(bench: Bench) -> None:
    bench.armed()
    _play(bench)
    bench.driven(60.0)


def _ending(bench: Bench) -> None:
    bench.armed()
    _play(bench, 1)
    eventually(lambda: bench.traced("start"), 12.0)
    bench.rest(POINTS * INTERVAL_S - ENDS_S)


def _interrupt(bench: Bench) -> None:
    time.sleep(1.0)
    bench.interrupt()


CASES: Final = {
    "SAFE, arm, goto": Case(_knob, _arm_and_go),
    "READY": Case(_ready, _nothing),
    "READY, goto": Case(_ready, _go_on),
    "RUN at rest": Case(_there, _nothing),
    "goto": Case(_going, _nothing),
    "wave": Case(_waving, _nothing),
    "wave, 38 s": Case(_waving, _nothing, LONG_S),
    "condition": Case(_conditioning, _nothing),
    "identify": Case(_identifying, _nothing),
    "HOLD": Case(_held, _nothing),
    "stop": Case(_there, _asks("stop")),
    "goto, stop": Case(_going, _asks("stop")),
    "during a stop": Case(_ramping, _nothing),
    "estop": Case(_there, _asks("estop")),
    "disarm": Case(_there, _asks("disarm")),
    "kill -9 of the loop": Case(_there, _kill_loop),
    "kill -9 of all, safe": Case(_there, _kill_all_and_safe),
    "kill -9 of all, run, arm": Case(_there, _kill_all_and_restart),
    "kill -9 of all, commission": Case(_there, _kill_all_and_commission),
    "kill -9 of commission, safe": Case(_commissioning, _kill_commission_and_safe),
    "kill -9 of commission, commission": Case(_commissioning, _kill_commission_and_repeat),
    "kill -9 of commission, run, arm": Case(_commissioning, _kill_commission_and_arm),
    "commission": Case(_commissioning, _nothing),
    "commission, Ctrl-C": Case(_commissioning, _interrupt),
    "READY, play": Case(_ready, _go_on_by_play, speaks="gcs"),
    "play, as it is loaded": Case(_loading, _nothing, speaks="gcs"),
    "play": Case(_playing, _nothing, speaks="gcs"),
    "play, its end": Case(_ending, _nothing, speaks="gcs"),
    "play, stop": Case(_playing, _asks("stop"), speaks="gcs"),
    "play, hold": Case(_playing, _asks("hold"), speaks="gcs"),
    "play, estop": Case(_playing, _asks("estop"), speaks="gcs"),
    "play, kill -9 of the loop": Case(_playing, _kill_loop, speaks="gcs"),
    "play, kill -9 of all, safe": Case(_playing, _kill_all_and_safe, speaks="gcs"),
    "play, kill -9 of all, run, arm": Case(_playing, _kill_all_and_restart, speaks="gcs"),
}
"""By name."""
