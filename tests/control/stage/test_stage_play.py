"""Plays of a stage: the devices are lent to a runner, and come back at a voltage that is known."""

from collections.abc import Sequence
from itertools import pairwise
from math import isnan, nan
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.control.stage.playing import PlayOutcome
from piezod.devices.interface import Device, Identity
from piezod.devices.played_axis import AxisTable
from piezod.devices.player import AtEnd, PlayerCapabilities
from piezod.devices.scan_table import ScanTable
from piezod.devices.wrapper import DeviceWrapper
from piezod.messages import requests as rq
from piezod.units import s_to_ns
from tests.control.rig_stage import RigStage, quick_config

PERIOD_V = (20.0, 40.0, 60.0, 40.0)
PLAY = rq.Play(drive_v=PERIOD_V, interval_s=0.01, cycles=5)


class PlayedByHand:
    """A runner whose play ends when the test says so."""

    def __init__(self) -> None:
        self.why, self.tables, self.aborts = "", list[AxisTable](), 0
        self.scans = list[ScanTable]()
        self._outcome: PlayOutcome | None = None

    def refusal(self, axis: int) -> str:
        """Refuse for the reason that the test gives."""
        assert axis == 0
        return self.why

    def capabilities(self, axis: int) -> PlayerCapabilities:
        """Return those of a player that holds its last value."""
        assert axis == 0
        numbers = (1000, 1000, 10**9, 100)
        return PlayerCapabilities(*numbers, False, (0.0,), 0, False, 100, True, 0, AtEnd.HOLDS)

    def begin(self, axis: int, table: AxisTable) -> None:
        """Begin a play that does not end by itself."""
        assert axis == 0
        self.tables.append(table)

    def scan_refusal(self, axes: Sequence[int], table: ScanTable) -> str:
        """Refuse for the reason that the test gives."""
        assert (list(axes), table.axes) == ([0], ("x",))
        return self.why

    def begin_scan(self, axes: Sequence[int], table: ScanTable) -> None:
        """Begin a scan that does not end by itself."""
        assert list(axes) == [0]
        self.scans.append(table)

    def abort(self) -> None:
        """Count the aborts."""
        self.aborts += 1

    def end(self, drive_v: float, failed: str = "", *, commanded: bool = False) -> None:
        """End the play at a voltage, in V."""
        self._outcome = PlayOutcome((drive_v,), failed, commanded)

    def outcome(self) -> PlayOutcome | None:
        """Return the end, once."""
        outcome, self._outcome = self._outcome, None
        return outcome


class SilentDevice(DeviceWrapper):
    """A device whose read-back may be missing.

    `false_v` is read back instead of what is right, unless it is NaN.
    """

    def __init__(self, device: Device, lag_ns: int) -> None:
        self._identity = device.open()
        super().__init__(device)
        self._able = self._able._replace(lag_ns=lag_ns)
        self.silent, self.false_v = False, nan

    def open(self) -> Identity:
        """Return who it is."""
        return self._identity

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the voltages, if it is not silent."""
        if self.silent:
            return self._unknown
        right = super().read_back(now_ns)
        return right if isnan(self.false_v) else [self.false_v] * len(right)


class PlayingStage(RigStage):
    """A stage that has begun a play.

    `start_s` is the instant at which the play begins; None is as soon as possible.
    """

    def __init__(
        self,
        *,
        reads_back: bool = True,
        start_s: float | None = None,
        lag_s: float = 0.0,
        config: DaemonConfig | None = None,
    ) -> None:
        self.runner, self._lag_ns = PlayedByHand(), s_to_ns(lag_s)
        super().__init__(config, self._wrapped, reads_back=reads_back, plays=self.runner)
        self.cycle()
        self.do(rq.Arm(confirm_output=not reads_back), PLAY.model_copy(update={"start_s": start_s}))
        for _ in range(5000):
            if self.runner.tables:
                break
            self.cycle()

    def _wrapped(self, device: Device) -> Device:
        self.device = SilentDevice(device, self._lag_ns)
        return self.device

    def end_at(self, drive_v: float, failed: str = "") -> None:
        """Leave the rig at a voltage, and give the devices back."""
        self.channels.devices["rig"].write([drive_v], self.t_ns)
        self.run(0.05)
        self.runner.end(drive_v, failed)


def test_table_is_played_between_ramps() -> None:
    """The axis ramps to the first voltage, lends the device, and ramps from its end to rest."""
    stage = PlayingStage()
    before_v = stage.x.drive_v
    stage.channels.writes.clear()
    lent = stage.run(0.5)
    written = list(stage.channels.writes)
    stage.end_at(40.0)
    stage.until("READY")
    stage.cycle()
    first_v, last_v = stage.channels.writes[0][1][0], stage.x.drive_v

    assert before_v == pytest.approx(PERIOD_V[0])
    assert stage.runner.tables[0].period_v.tolist() == list(PERIOD_V)
    assert written == []
    assert {record.state for record in lent} == {"IDENT"}
    assert first_v == pytest.approx(40.0, abs=0.8)
    assert last_v == pytest.approx(0.0)
    assert stage.faults() == ["D10"]  # `piezod condition` makes the memory known again


@pytest.mark.parametrize("request_", [rq.Stop(), rq.Estop(), rq.Hold(), rq.Shutdown()])
def test_request_aborts_a_play(request_: rq.Request) -> None:
    """Nothing is written before the device is back; then the voltage in force is the start."""
    stage = PlayingStage()
    stage.channels.writes.clear()
    stage.do(request_)
    stage.run(0.2)
    before = list(stage.channels.writes)
    stage.end_at(60.0)
    stage.run(0.02)
    steps_v = [60.0, *(drive_v for _, (drive_v,) in stage.channels.writes)]

    assert before == []
    assert stage.runner.aborts == 1
    assert max(abs(b - a) for a, b in pairwise(steps_v)) < 0.8
    assert set(stage.faults()) <= {"D10", "E1"}


def test_ramp_begins_at_the_read_back_after_the_play() -> None:
    """It is later than what the runner reports, here 60 V: the output is at 20 V."""
    stage = PlayingStage()
    stage.channels.writes.clear()
    stage.do(rq.Estop())
    stage.runner.end(60.0)
    stage.until("FAULT")

    assert stage.channels.writes[0][1][0] == pytest.approx(20.0, abs=0.8)


@pytest.mark.parametrize("false_v", [0.0, 35.0, 70.0, 140.0])
def test_false_read_back_after_a_play_is_not_driven_from(false_v: float) -> None:
    """The end of the table stands against it: the sensor decides, or nothing is written."""
    stage = PlayingStage(config=quick_config())
    stage.channels.writes.clear()
    stage.device.false_v = false_v
    stage.runner.end(20.0, commanded=True)
    stage.run(0.5)
    written_v = [drive_v for _, (drive_v,) in stage.channels.writes]

    assert bool(written_v) == (false_v > 50.0)  # which the sensor excludes
    assert not written_v or written_v[0] == pytest.approx(20.0, abs=1.2)


@pytest.mark.parametrize("towards", [-0.9, 0.9])
def test_writes_after_a_play_go_on_from_its_last_point(towards: float) -> None:
    """A read-back within a cycle of it may be late: both are near the writes that follow."""
    stage = PlayingStage(config=quick_config())
    step_v = stage.config.axes["x"].limits.slew_v_per_s / stage.config.rate_hz
    stage.channels.writes.clear()
    stage.device.false_v = 20.0 + towards * step_v
    stage.runner.end(20.0, commanded=True)
    stage.run(0.1)
    written_v = [drive_v for _, (drive_v,) in stage.channels.writes]

    assert written_v[0] == pytest.approx(20.0, abs=1.2)


@pytest.mark.parametrize("false_v", [70.0, 140.0])
def test_false_read_back_after_an_abort_is_not_driven_from(false_v: float) -> None:
    """What the amplifier measures at the abort is no second witness: the sensor excludes it."""
    stage = PlayingStage()
    stage.channels.writes.clear()
    stage.device.false_v = false_v
    stage.do(rq.Stop())
    stage.runner.end(false_v)
    stage.until("FAULT")

    assert stage.channels.writes == []


@pytest.mark.parametrize("told_v", [60.0, nan])
def test_no_voltage_counts_before_the_devices_read_back(told_v: float) -> None:
    """Whatever the runner reports, without a read-back it is A1, and nothing is written."""
    stage = PlayingStage()
    stage.channels.writes.clear()
    stage.do(rq.Stop())
    stage.device.silent = True
    stage.end_at(60.0)
    stage.runner.end(told_v)
    stage.until("BLIND")
    before = list(stage.channels.writes)
    stage.device.silent = False
    stage.until("SAFE")
    steps_v = [60.0, *(drive_v for _, (drive_v,) in stage.channels.writes)]

    assert before == []
    assert "A1" in stage.faults()
    assert max(abs(b - a) for a, b in pairwise(steps_v)) < 0.8


def test_a_read_back_that_comes_as_late_as_the_device_is_slow_is_no_fault() -> None:
    """The first round of a slow device behind a worker takes several cycles."""
    lag_s = 0.1
    stage = PlayingStage(lag_s=lag_s)
    stage.do(rq.Stop())
    stage.device.silent = True
    stage.end_at(60.0)
    stage.run(lag_s)
    stage.device.silent = False
    stage.until("SAFE")

    assert stage.faults() == []


def test_failed_play_is_reported() -> None:
    """The reason of the device is an event, and the axis returns to rest."""
    stage = PlayingStage()
    stage.end_at(20.0, failed="the device lost its table")
    stage.until("READY")

    assert any("lost its table" in event.text for event in stage.events)
    assert stage.x.drive_v == pytest.approx(0.0)


def test_unknown_voltage_is_not_driven() -> None:
    """Without a read-back, a play that ends at an unknown voltage leaves the output alone."""
    stage = PlayingStage(reads_back=False)
    stage.channels.writes.clear()
    stage.end_at(60.0)
    stage.runner.end(nan)
    stage.until("FAULT")

    assert stage.channels.writes == []
    assert "A1" in stage.faults()


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (PLAY.model_copy(update={"drive_v": (0.0, 151.0)}), "allowed range 0 to 150 V"),
        (PLAY.model_copy(update={"drive_v": (0.0, nan)}), "is nan V"),
        (PLAY.model_copy(update={"interval_s": 1e-6}), "allowed: at most 20000 V/s"),
        (PLAY.model_copy(update={"axis": "z"}), "no axis 'z'"),
    ],
)
def test_table_beyond_a_limit_is_refused(request_: rq.Play, why: str) -> None:
    """A table is refused as a whole, before anything moves."""
    stage = RigStage(plays=PlayedByHand()).armed()
    answer = stage.ask(request_)

    assert why in answer.why
    assert stage.state == "READY"


def test_play_is_refused_where_it_cannot_be() -> None:
    """A stage without a player, in shadow, disarmed or moving says why it plays nothing."""
    plain = RigStage().armed()
    shadow, moving = RigStage(plays=PlayedByHand()), RigStage(plays=PlayedByHand())
    shadow.cycle()
    moving.cycle()
    disarmed = moving.ask(PLAY).why
    shadow.do(rq.Arm(shadow=True))
    moving.do(rq.Arm(), rq.SelectMode(mode=Mode.FEEDFORWARD))

    assert "no device that plays tables" in plain.ask(PLAY).why
    assert "shadow" in shadow.ask(PLAY).why
    assert "`piezod arm` first" in disarmed
    assert "`piezod stop`" in moving.ask(PLAY).why


def scan_request(
    top_v: float = 60.0, points: int = 200, interval_s: float = 0.01, **other: Any
) -> rq.Scan:
    """Return a scan of four sweeps of one axis."""
    line_v = top_v * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(points) / points))
    curve = {
        "lead_in_v": (0.0, 0.0),
        "line_v": tuple(line_v.tolist()),
        "offset_v": (0.0, 0.1, 0.2, 0.3),
        "scale": (1.0,) * 4,
        "blend": tuple(np.linspace(0.0, 1.0, points).tolist()),
    }
    return rq.Scan.model_validate({"axes": {"x": {**curve, **other}}, "interval_s": interval_s})


def test_scan_is_played_between_ramps() -> None:
    """As a table: the curves arrive as they were sent, and the axis goes to rest afterwards."""
    runner = PlayedByHand()
    stage = RigStage(plays=runner).armed(scan_request())
    stage.run(0.1)
    runner.end(0.0, commanded=True)
    stage.until("READY")

    (table,) = runner.scans
    assert (table.sweeps, table.points, table.axes) == (4, 200, ("x",))
    assert table.line_v[:, 0].max() == pytest.approx(60.0, rel=1e-4)


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (scan_request(200.0), "allowed range 0 to 150 V"),
        (scan_request(140.0, points=4, interval_s=1e-3), "V/s; scan more slowly"),
        (
            scan_request(offset_v=(0.0, 0.0, 80.0, 0.0), blend=(0.0,) * 200, interval_s=1e-3),
            "V/s; scan more slowly",
        ),
    ],
)
def test_scan_beyond_a_limit_is_refused(request_: rq.Scan, why: str) -> None:
    """Before anything moves, with axis and limit."""
    runner = PlayedByHand()
    stage = RigStage(plays=runner).armed()
    answer = stage.ask(request_)

    assert why in answer.why
    assert stage.state == "READY"
    assert not runner.scans


def test_curves_that_do_not_fit_each_other_are_refused() -> None:
    """The error names the curve and the wanted number."""
    with pytest.raises(ValidationError, match="has 3 numbers, 4 are needed"):
        scan_request(scale=(1.0,) * 3)
    with pytest.raises(ValidationError, match="a multiple of 150 is needed"):
        scan_request(blend=(0.0,) * 150)
