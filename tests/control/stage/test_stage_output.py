"""Tests of outputs and read-backs that do not obey: no write is far from the voltage in force."""

from collections.abc import Callable, Sequence
from itertools import count
from math import nan
from typing import Any, cast

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.watch.sensor import SensorWatch
from piezod.devices.interface import Device, Sample
from piezod.messages import requests as rq
from piezod.testing.faulty import SensorAmplifier
from piezod.units import s_to_ns
from tests.control.rig_stage import RigStage, quick_config, shipped_config, with_axis

SLEW_V_PER_S, RATE_HZ, TOLERANCE_V = 400.0, 200, 0.75
STEP_V = SLEW_V_PER_S / RATE_HZ
FREE_V_PER_S = 20_000.0
"""A slew rate at which one step is most of the range: no write waits for the output."""

Values = Callable[[float], float]


class Unruly:
    """A rig whose output and read-back obey or not, and which traces both.

    When it obeys again, its output takes the last write. `steps_v` has the distance of each write
    from the voltage in force before it.
    """

    def __init__(self, inner: SensorAmplifier) -> None:
        self.inner, self.obeys = inner, True
        self.reads: Values = lambda drive_v: drive_v
        self.output_v = 0.0
        self.steps_v: list[float] = []
        self._waiting_v = 0.0

    def __getattr__(self, name: str) -> Any:
        """Leave everything else to the rig."""
        return getattr(self.inner, name)

    def fall(self, drive_v: float, now_ns: int) -> None:
        """Let the output go to a voltage by itself."""
        self.output_v = self._waiting_v = drive_v
        self.inner.write([drive_v], now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Trace the write; pass it on if the output obeys."""
        self.steps_v.append(abs(drive_v[0] - self.output_v))
        self._waiting_v = drive_v[0]
        return self._settle(now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return what the read-back shows."""
        self._settle(now_ns)
        return [self.reads(self.output_v)]

    def _settle(self, now_ns: int) -> bool:
        if self.obeys and self._waiting_v != self.output_v:
            self.output_v = self._waiting_v
            return self.inner.write([self.output_v], now_ns)
        return True


class UnrulyStage(RigStage):
    """A stage on such a rig, in position and at rest."""

    def __init__(
        self,
        position_um: float = 15.0,
        config: DaemonConfig | None = None,
        slew_v_per_s: float = SLEW_V_PER_S,
    ) -> None:
        config = config or shipped_config()
        slow = config.axes["x"].limits.model_copy(update={"slew_v_per_s": slew_v_per_s})
        conditioning = quick_config().axes["x"].conditioning
        config = with_axis(config, limits=slow, conditioning=conditioning)
        super().__init__(config, lambda device: cast("Device", Unruly(cast("Any", device))))
        (self.rig,) = cast("tuple[Unruly]", self.wrapped)
        self.cycle()
        if position_um:
            self.do(rq.Arm(), rq.Goto(position_um=position_um))
            self.run(1.0)
        self.rig.steps_v.clear()

    def texts(self) -> str:
        """Return the events about the output."""
        return "\n".join(event.text for event in self.events if event.kind == "output")


def wave() -> rq.Wave:
    """Return a wave over most of the range."""
    sine = {"kind": "sine", "low": 2, "high": 22, "frequency_hz": 1}
    return rq.Wave.model_validate({"command_um": {"x": sine}, "duration_s": 20})


COMMANDS: list[Any] = [
    rq.Stop(),
    rq.Goto(position_um=2.0),
    rq.Goto(position_um=24.0),
    wave(),
    rq.Condition(),
    rq.Disarm(),
    rq.Hold(),
    rq.Estop(),
]


@pytest.mark.fault("A3")
@pytest.mark.parametrize("request_", COMMANDS, ids=lambda each: each.kind)
def test_stuck_output_is_waited_for(request_: rq.Request) -> None:
    """No write leaves it by more than a step; released, it is ramped down from where it is."""
    stage = UnrulyStage()
    if isinstance(request_, rq.Condition):
        stage.do(rq.Stop())
        stage.until("SAFE")
        stage.do(rq.Arm())
    stage.rig.obeys = False
    stage.ask(request_)
    stage.run(4.0)
    waits = State(stage.state)
    stage.rig.obeys = True
    stage.run(4.0)
    stage.ask(rq.Stop())
    stage.run(4.0)

    assert max(stage.rig.steps_v) <= STEP_V + TOLERANCE_V
    assert waits in {State.RAMP, State.ESTOP, State.HOLD, State.FAULT}
    assert stage.rig.output_v == pytest.approx(0.0, abs=TOLERANCE_V)


@pytest.mark.fault("A3")
def test_output_that_never_follows_is_left_where_it_is() -> None:
    """After half a minute the ramp has failed; the last words name the voltage that stays."""
    stage = UnrulyStage()
    stage.rig.obeys = False
    stuck_v = stage.rig.output_v
    stage.do(rq.Stop())
    stage.run(25.0)
    waits = State(stage.state)
    stage.until("FAULT")
    refused = stage.ask(rq.Arm())
    stage.rig.obeys = True
    stage.run(1.5)
    stage.do(rq.Reset(), rq.Arm(), rq.Stop())
    stage.until("SAFE", 20.0)

    assert waits is State.RAMP
    assert f"the voltage stays: {stuck_v:.4g} V read back" in stage.texts()
    assert not refused.accepted
    assert max(stage.rig.steps_v) <= STEP_V + TOLERANCE_V
    assert stage.rig.output_v == pytest.approx(0.0, abs=TOLERANCE_V)


LIES: dict[str, Values] = {
    "stuck": lambda _v: 68.0,
    "low": lambda _v: 30.0,
    "high": lambda _v: 120.0,
    "zero": lambda _v: 0.0,
    "scaled": lambda drive_v: 0.7 * drive_v,
    "more": lambda drive_v: 1.4 * drive_v,
    "shifted": lambda drive_v: drive_v + 25.0,
}


@pytest.mark.fault("A3")
@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("request_", [rq.Stop(), wave(), rq.Goto(position_um=5.0)], ids=repr)
def test_false_read_back_makes_no_step(request_: rq.Request, lie: str) -> None:
    """The sensor shows that the output obeys: the stage is ramped down, and cannot be armed."""
    stage = UnrulyStage()
    stage.rig.reads = LIES[lie]
    stage.ask(request_)
    stage.run(9.0)
    stage.ask(rq.Stop())
    stage.run(9.0)
    ended_v, ended = stage.rig.output_v, State(stage.state)
    stage.ask(rq.Reset(engineer=True))
    stage.ask(rq.Arm())
    stage.run(0.2)

    assert max(stage.rig.steps_v) <= STEP_V + 1e-9
    assert ended is State.FAULT
    assert ended_v == pytest.approx(0.0, abs=TOLERANCE_V)


@pytest.mark.parametrize("lie", ["stuck", "low", "shifted"])
def test_false_read_back_at_rest_is_not_armed(lie: str) -> None:
    """The own last write and the sensor contradict it; a person may answer for it."""
    stage = UnrulyStage()
    stage.do(rq.Stop())
    stage.until("SAFE")
    stage.rig.reads = LIES[lie]
    stage.run(0.1)
    stage.rig.steps_v.clear()
    refused = stage.ask(rq.Arm())
    written = list(stage.rig.steps_v)
    stage.rig.reads = lambda drive_v: drive_v
    stage.run(0.1)
    accepted = stage.ask(rq.Arm())

    assert "last write 0 V" in refused.why
    assert "confirm-output" in refused.why
    assert (refused.accepted, written, accepted.accepted) == (False, [], True)


@pytest.mark.fault("A3")
@pytest.mark.parametrize("fallen_to", [0.0, 0.85])
def test_output_that_falls_by_itself_is_ramped_from_there(fallen_to: float) -> None:
    """The sensor shows the fall: nothing is written before, and then from the read-back."""
    stage = UnrulyStage()
    stage.rig.fall(fallen_to * stage.rig.output_v, stage.t_ns)
    stage.run(8.0)

    assert max(stage.rig.steps_v) <= STEP_V + TOLERANCE_V
    assert stage.rig.output_v == pytest.approx(0.0, abs=TOLERANCE_V)


def test_way_within_the_error_of_the_model_proves_nothing() -> None:
    """With a model that is wrong by 2 µm, a fall by 2 µm is left to a person."""
    stage = UnrulyStage()
    watch = stage.stage.watches[0].sensor
    assert isinstance(watch, SensorWatch)
    watch.model_error_um = 2.0
    stage.rig.fall(0.85 * stage.rig.output_v, stage.t_ns)
    stage.rig.steps_v.clear()
    stage.run(3.0)

    assert max(stage.rig.steps_v, default=0.0) <= STEP_V + TOLERANCE_V
    assert "nothing tells which of them is right" in stage.texts()


@pytest.mark.parametrize("gain", [0.9, 1.15])
@pytest.mark.few(1)
def test_way_within_what_was_learned_from_a_lying_sensor_proves_nothing(gain: float) -> None:
    """An output sticks; the fault drops what was learned, and with it the expected position."""
    stage = UnrulyStage(position_um=0.0)
    stage.do(rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE))
    read, since_ns = stage.rig.inner.read, stage.t_ns

    def lying(now_ns: int) -> Sequence[Sample]:
        (sample,) = read(now_ns)
        shown = 1.0 + (gain - 1.0) * min((now_ns - since_ns) / s_to_ns(2.0), 1.0)
        return [sample._replace(position_um=shown * sample.position_um)]

    stage.rig.read = lying  # type: ignore[attr-defined] # in place of that of the rig
    stage.do(wave().model_copy(update={"duration_s": 1000.0}))
    stage.run(30.3)
    stage.rig.steps_v.clear()
    stage.rig.obeys = False
    stage.run(5.0)

    assert max(stage.rig.steps_v) <= STEP_V + TOLERANCE_V


def test_way_proves_nothing_while_the_memory_is_unknown() -> None:
    """The model expects a wrong way then: a fall by 2 µm is left to a person."""
    stage = UnrulyStage()
    stage.stage._memory_known = False  # noqa: SLF001 - as after a fault of the output
    stage.run(0.2)
    stage.rig.fall(0.85 * stage.rig.output_v, stage.t_ns)
    stage.rig.steps_v.clear()
    stage.run(3.0)

    assert max(stage.rig.steps_v, default=0.0) <= STEP_V + TOLERANCE_V
    assert "nothing tells which of them is right" in stage.texts()


@pytest.mark.fault("A3")
@pytest.mark.parametrize("of", [2, 3])
def test_stuck_output_is_waited_for_with_a_read_back_now_and_then(of: int) -> None:
    """One reply in two or three is lost: the reach grows with the age of the last one only."""
    stage, replies = UnrulyStage(), count()
    stage.rig.reads = lambda drive_v: drive_v if next(replies) % of == 0 else nan
    stage.rig.obeys = False
    stage.do(rq.Stop())
    stage.run(5.0)

    assert max(stage.rig.steps_v) <= of * STEP_V + TOLERANCE_V


@pytest.mark.fault("P2")
def test_false_read_back_of_a_killed_daemon_is_not_taken_for_the_safe_voltage() -> None:
    """It wrote 60 V last: with a read-back of 0 V the voltage is unknown, and the log says so."""
    stage = UnrulyStage(position_um=0.0)
    stage.rig.fall(60.0, stage.t_ns)
    stage.rig.reads = LIES["zero"]
    stage.stage.boundary.written_v = [60.0]
    stage.kill_loop()
    stage.rig.steps_v.clear()
    stage.run(40.0)

    assert (stage.state, stage.rig.steps_v) == ("FAULT", [])
    assert "last write 60 V" in stage.texts()


@pytest.mark.parametrize(("noted_v", "offset_um"), [(0.0, 0.0), (0.0, 20.0), (1.9, 0.0)])
def test_new_loop_ramps_where_read_back_and_last_write_agree(
    noted_v: float, offset_um: float
) -> None:
    """The last write may not have arrived; the zero of the sensor is not known yet."""
    stage = UnrulyStage(position_um=8.0)
    read = stage.rig.inner.read
    stage.rig.read = lambda now_ns: [  # type: ignore[attr-defined] # in place of that of the rig
        sample._replace(position_um=sample.position_um + offset_um) for sample in read(now_ns)
    ]
    stage.stage.boundary.written_v = [stage.rig.output_v + noted_v]
    stage.kill_loop()
    stage.run(5.0)

    assert stage.rig.output_v == pytest.approx(0.0, abs=TOLERANCE_V)


def test_stop_in_fault_says_what_helps_while_a_voltage_stays() -> None:
    """Nothing is driven in FAULT; the emergency stop ramps down."""
    stage = UnrulyStage()
    stage.rig.obeys = False
    stage.do(rq.Stop())
    stage.until("FAULT", 60.0)
    stage.rig.obeys = True
    refused = stage.ask(rq.Stop())
    stage.do(rq.Estop())
    stage.run(5.0)

    assert "`piezod estop`" in refused.why
    assert stage.rig.output_v == pytest.approx(0.0, abs=TOLERANCE_V)
    assert stage.ask(rq.Stop()).accepted


@pytest.mark.fault("A3")
@pytest.mark.parametrize("end", [rq.Stop(), rq.Estop(), rq.Shutdown()], ids=lambda each: each.kind)
def test_missing_read_back_at_the_end_of_a_ramp_is_not_the_safe_voltage(end: rq.Request) -> None:
    """All writes have arrived; the output has not, and the next read-back shows it."""
    stage = UnrulyStage(slew_v_per_s=FREE_V_PER_S)
    stage.rig.obeys = False
    stage.ask(end)
    for _ in range(40 * RATE_HZ):
        arrives = abs(stage.stage.axes[0].law.in_force_v) < TOLERANCE_V
        gap = arrives and (stage.records[-1].axes[0].read_back_v > TOLERANCE_V)
        stage.rig.reads = (lambda _: nan) if gap else (lambda drive_v: drive_v)
        if stage.cycle().state in {State.FAULT, State.SAFE, State.STOPPING}:
            break

    assert stage.state == ("STOPPING" if isinstance(end, rq.Shutdown) else "FAULT")
    assert f"the voltage stays: {stage.rig.output_v:.4g} V read back" in stage.texts()


@pytest.mark.fault("P1")
def test_last_record_of_an_end_has_the_voltage_that_is_read_back() -> None:
    """The own last write was at the safe voltage, and the output did not follow it."""
    stage = UnrulyStage(slew_v_per_s=FREE_V_PER_S)
    stage.rig.obeys = False
    stage.ask(rq.Shutdown())
    stage.until("STOPPING", 60.0)

    assert stage.x.drive_v == stage.rig.output_v > TOLERANCE_V


def test_stop_in_fault_is_refused_while_nothing_is_read_back() -> None:
    """The last write says nothing about the output."""
    stage = UnrulyStage(slew_v_per_s=FREE_V_PER_S)
    stage.rig.obeys = False
    stage.do(rq.Stop())
    stage.until("FAULT", 60.0)
    stage.stage.axes[0].track(0.0)
    stage.rig.reads = lambda _: nan
    stage.cycle()
    refused = stage.ask(rq.Stop())

    assert not refused.accepted
    assert "unknown" in refused.why
    assert "`piezod estop`" in refused.why
