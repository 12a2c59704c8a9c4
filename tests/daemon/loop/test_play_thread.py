"""A play in its thread: load, start, wait, record; aborted, failed, or without an end."""

import json
from collections.abc import Callable
from math import nan
from pathlib import Path
from threading import Event
from typing import Any, cast

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.control.stage.playing import PlayOutcome
from piezod.daemon.loop import device_play, play_thread
from piezod.daemon.loop.device_play import PlayError
from piezod.daemon.loop.placement import DevicePlace, Placement, RoundTrips
from piezod.daemon.loop.play_thread import AxisPlayer, PlayThreads
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Device, Identity
from piezod.devices.played_axis import AxisTable, PlayedAxis
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.devices.wiring import ChannelPair, pairs_of, wiring_of
from piezod.errors import DeviceError
from piezod.hysteresis.memory import FloatArray
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.daemon.loop.play_stage import no_scan
from tests.daemon.waiting import eventually
from tests.devices.fake_link import WHO, FakeLink

TEN_VOLTS_PER_VOLT = LineCalibration(kind="line", gain=10.0)
LIMITED = {
    "limits": {"drive_min_v": 0.0, "drive_max_v": 150.0, "slew_v_per_s": 1000.0, "rest_v": 0.0},
    "command_range_um": (0.0, 26.0),
}
LIMITS, PERIOD_NS = Limits(0.0, 150.0, 1000.0), 1_000_000
NEAR_V = 1.0 + LIMITS.read_back_tolerance_v
TABLE = AxisTable(1_000_000, np.empty(0), np.array([20.0, 40.0, 30.0]), 2)


class FakePlayer:
    """A player that is in the state which the test gives."""

    def __init__(self, at_end: AtEnd = AtEnd.HOLDS) -> None:
        self.state, self.reason, self.at_end = PlayState.LOADED, "", at_end
        self.loaded: Table | None = None
        self.output = 2.0
        self.refuses = self.refuses_capabilities = self.unreadable = ""
        self.slow = ""
        """The exchange that does not end before it is cancelled: load or record."""
        self.under_way = ""

    def step(self, name: str, check: Check) -> None:
        """Stay in a slow exchange until its check ends it."""
        self.under_way = name
        while name == self.slow:
            check()

    def capabilities(self) -> Capabilities:
        return Capabilities(("x",), ("x",), read_back=True, max_rate_hz=1000.0)

    def read_back(self, now_ns: int) -> list[float]:  # noqa: ARG002 - as the protocol has it
        return [self.output]

    def player_capabilities(self) -> PlayerCapabilities:
        if self.refuses_capabilities:
            raise DeviceError(self.refuses_capabilities)
        return PlayerCapabilities(
            *(1000, 1000, 10**9, 100), False, (0.001,), 10, False, 100, True, 0, self.at_end
        )

    def load(self, table: Table, check: Check) -> Table:
        self.step("load", check)
        if self.refuses:
            raise DeviceError(self.refuses)
        self.loaded = table
        return table

    def arm(self) -> None:
        self.state = PlayState.ARMED

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - as the protocol has it
        self.state = PlayState.PLAYING

    def replace(self, period: FloatArray) -> FloatArray:
        return period

    def progress(self, now_ns: int) -> Progress:  # noqa: ARG002 - as the protocol has it
        return Progress(self.state, 0, self.reason)

    def abort(self, now_ns: int) -> tuple[float, ...]:  # noqa: ARG002 - as the protocol has it
        self.state = PlayState.IDLE
        return (2.5,)

    def recording(self, check: Check) -> PlayedRecord:
        self.step("record", check)
        if self.unreadable:
            raise PlayError(self.unreadable)
        positions = np.array([[1.0], [np.nan], [2.0]])
        return PlayedRecord(1_000_000, positions, 0, np.empty((3, 0)))


class Played:
    """One play with a fake player, whose channels are calibrated 10 V per V and 3 µm per unit."""

    def __init__(
        self,
        folder: Path,
        player: FakePlayer,
        table: AxisTable = TABLE,
        idle: Callable[[], bool] = lambda: True,
    ) -> None:
        pair = ChannelPair(
            "dev",
            "dev",
            to_um=LineCalibration(kind="line", gain=3.0),
            to_v=TEN_VOLTS_PER_VOLT,
        )
        axis = PlayedAxis("x", {"dev": cast("Device", player)}, {"x": pair})
        # The zero of the sensor is at 1 µm.
        self.file, self.clock = folder / "play.json", FakeClock()
        self.threads = PlayThreads(
            {0: AxisPlayer(axis, Identity("maker", "model", "7", "1.0"), LIMITS, PERIOD_NS)},
            {1: "no player"},
            idle,
            lambda _axis: 1.0,
            self.clock,
            self.file,
            no_scan,
        )
        self.threads.begin(0, table)

    def outcome(self) -> PlayOutcome:
        """Wait for the end."""
        found = eventually(self.threads.outcome)
        assert found is not None
        return found

    def document(self) -> dict[str, Any]:
        """Return the stored record."""
        document: dict[str, Any] = json.loads(self.file.read_text())
        return document


def test_table_and_record_are_calibrated(tmp_path: Path) -> None:
    """The device gets its own units, the record has µm, and the end is that of the table."""
    player = FakePlayer()
    played = Played(tmp_path, player)
    eventually(lambda: player.state is PlayState.PLAYING)
    running = played.threads.outcome()
    player.state = PlayState.ENDED
    outcome, document = played.outcome(), played.document()

    assert running is None
    assert player.loaded is not None
    assert player.loaded.period[:, 0].tolist() == pytest.approx([2.0, 4.0, 3.0])
    assert outcome.drives_v == pytest.approx((30.0,))
    assert outcome.failed == ""
    assert document["position_um"] == [pytest.approx(2.0), None, pytest.approx(5.0)]
    assert document["drive_v"] == pytest.approx([20.0, 40.0, 30.0])
    assert (document["number"], document["failed"], document["cycles"]) == (1, "", 2)
    assert document["device"] == {"maker": "maker", "model": "model", "serial": "7"}


@pytest.mark.parametrize(
    ("output_v", "starts"),
    [(20.0 + 0.9 * NEAR_V, True), (20.0 + 1.1 * NEAR_V, False), (0.0, False), (nan, False)],
)
def test_play_starts_at_the_output_only(tmp_path: Path, output_v: float, starts: bool) -> None:
    """An output that has gone away while a table was loaded, or is not read back, is not stepped.

    It may be as far from the first point as a write of the loop from its read-back.
    """
    player = FakePlayer()
    player.output = output_v / 10.0
    played = Played(tmp_path, player)
    if starts:
        eventually(lambda: player.state is PlayState.PLAYING)
        return
    outcome = played.outcome()

    assert player.state is PlayState.IDLE
    assert "20 V" in outcome.failed
    assert (outcome.drives_v, outcome.commanded) == ((20.0,), True)


def test_abort_ends_a_play(tmp_path: Path) -> None:
    """The voltage is the one that the device reports after the abort."""
    player = FakePlayer()
    played = Played(tmp_path, player)
    eventually(lambda: player.state is PlayState.PLAYING)
    played.threads.abort()

    assert played.outcome().drives_v == pytest.approx((25.0,))
    assert player.state is PlayState.IDLE
    assert played.document()["failed"] == "it was aborted"


@pytest.mark.parametrize("slow", ["load", "record"])
def test_abort_does_not_wait_for_a_table(tmp_path: Path, slow: str) -> None:
    """It ends loading and reading in their middle.

    Before the start the voltage is the first one, which the loop has written; after the end it is
    the last one.
    """
    player = FakePlayer()
    player.slow = slow
    played = Played(tmp_path, player)
    if slow == "record":
        eventually(lambda: player.state is PlayState.PLAYING)
        player.state = PlayState.ENDED
    eventually(lambda: player.under_way == slow)
    played.threads.abort()
    outcome = played.outcome()

    assert outcome == PlayOutcome((20.0 if slow == "load" else 30.0,), commanded=True)
    assert played.document()["failed"] == "it was aborted"


def test_play_whose_record_cannot_be_read_has_ended_at_its_last_voltage(tmp_path: Path) -> None:
    """What the device has recorded may be as wrong as its read-back."""
    player = FakePlayer()
    player.unreadable = "the recorded values differ from the table"
    played = Played(tmp_path, player)
    eventually(lambda: player.state is PlayState.PLAYING)
    player.state = PlayState.ENDED

    assert played.outcome() == PlayOutcome((30.0,), player.unreadable, commanded=True)


def test_play_begins_at_its_instant(tmp_path: Path) -> None:
    """The device is ready before, and started when the instant has come."""
    player = FakePlayer()
    played = Played(tmp_path, player, TABLE._replace(start_ns=3600 * 10**9))
    eventually(lambda: player.state is PlayState.ARMED)
    played.clock.sleep_until_ns(3600 * 10**9)

    eventually(lambda: player.state is PlayState.PLAYING)
    player.state = PlayState.ENDED
    assert played.outcome().failed == ""


def test_abort_before_the_instant_starts_nothing(tmp_path: Path) -> None:
    """A play that waits for its instant is aborted; the voltage is the one that it begins at."""
    player = FakePlayer()
    played = Played(tmp_path, player, TABLE._replace(start_ns=3600 * 10**9))
    eventually(lambda: player.state is PlayState.ARMED)
    played.threads.abort()

    assert played.outcome().drives_v == pytest.approx((20.0,))
    assert played.document()["failed"] == "it was aborted"


def test_play_whose_instant_has_passed_fails(tmp_path: Path) -> None:
    """A device that took too long to take its table is not started."""
    player = FakePlayer()
    played = Played(tmp_path, player, TABLE._replace(start_ns=1))

    assert "after the start: start later" in played.outcome().failed
    assert player.state is PlayState.IDLE


def test_voltage_after_an_end_without_source_is_unknown(tmp_path: Path) -> None:
    """If no source says what the device does at the end, the outcome has no voltage."""
    player = FakePlayer(AtEnd.UNKNOWN)
    played = Played(tmp_path, player)
    eventually(lambda: player.state is PlayState.PLAYING)
    player.state = PlayState.ENDED

    assert np.isnan(played.outcome().drives_v).all()


def test_failure_of_the_device_is_the_reason(tmp_path: Path) -> None:
    """A refused table, and a play that fails, end with the words of the device."""
    refusing, failing = FakePlayer(), FakePlayer()
    refusing.refuses = "the table has too many points"
    refused = Played(tmp_path, refusing).outcome()
    played = Played(tmp_path, failing)
    eventually(lambda: failing.state is PlayState.PLAYING)
    failing.reason, failing.state = "samples were lost", PlayState.FAILED
    failed = played.outcome()

    assert refused.failed == "the table has too many points"
    assert failed.failed == "samples were lost"
    assert played.document()["failed"] == "samples were lost"


def test_play_without_an_end_is_aborted(tmp_path: Path) -> None:
    """A device that plays on long after the end of its table is stopped."""
    player = FakePlayer()
    played = Played(tmp_path, player)
    eventually(lambda: player.state is PlayState.PLAYING)
    played.clock.spend_ns(TABLE.duration_ns + 2 * device_play.GRACE_NS)

    assert "plays on" in played.outcome().failed
    assert player.state is PlayState.IDLE


def test_delay_of_the_thread_is_no_fault_of_the_device(tmp_path: Path) -> None:
    """A busy machine may take the processor from the thread after the device has answered."""

    class DelayedPlayer(FakePlayer):
        def progress(self, now_ns: int) -> Progress:
            answer = super().progress(now_ns)
            if answer.state is PlayState.PLAYING:
                assert begun.wait(10.0)
                played.clock.spend_ns(TABLE.duration_ns + 2 * device_play.GRACE_NS)
                self.state = PlayState.ENDED
            return answer

    begun = Event()
    played = Played(tmp_path, DelayedPlayer())
    begun.set()

    assert not played.outcome().failed


def test_device_that_is_not_free_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lost device, or one that does not answer, belongs to another thread: nothing is sent."""
    monkeypatch.setattr(device_play, "IDLE_WITHIN_S", 3 * device_play.POLL_S)
    player = FakePlayer()
    played = Played(tmp_path, player, idle=lambda: False)
    outcome = played.outcome()

    assert np.isnan(outcome.drives_v).all()
    assert "was lost, or did not answer" in outcome.failed
    assert (player.loaded, player.state) == (None, PlayState.LOADED)


def test_devices_are_free_when_they_are_there_and_no_round_is_under_way() -> None:
    """A device that is being opened again belongs to the thread that opens it."""
    link = FakeLink()
    reconnecting = ReconnectingDevice(link, WHO)
    worker = DeviceWorker(reconnecting, FakeClock(), 1, 1)
    able = link.capabilities()
    trips = RoundTrips(1, 1, 1, 1, 1)
    placement = Placement(
        "dev", DevicePlace.WORKER, trips, WHO, able, 1.0, worker, (), reconnecting
    )
    free = play_thread.all_free([placement])
    worker.read(1)
    requested = play_thread.all_free([placement])
    worker.thread.start()
    eventually(lambda: worker.idle)
    ended = play_thread.all_free([placement])
    link.pulled = True
    worker.read(2)
    eventually(lambda: not reconnecting.there)
    lost = play_thread.all_free([placement])
    worker.close()

    assert (free, requested, ended, lost) == (True, False, True, False)


def test_capabilities_are_asked_once(tmp_path: Path) -> None:
    """Not by each play, in whose beginning a worker still uses the line; a refusal says why."""
    player, mute = FakePlayer(), FakePlayer()
    played = Played(tmp_path, player)
    able = played.threads.capabilities(0)
    player.refuses_capabilities = mute.refuses_capabilities = "no reply"
    eventually(lambda: player.state is PlayState.PLAYING)
    player.state = PlayState.ENDED

    assert played.threads.capabilities(0) == able
    assert not played.outcome().failed
    with pytest.raises(DeviceError, match="no reply"):
        Played(tmp_path, mute)


def test_axis_without_player_says_why(tmp_path: Path) -> None:
    """The refusal is that of the axis."""
    played = Played(tmp_path, FakePlayer())

    assert played.threads.refusal(0) == ""
    assert played.threads.refusal(1) == "no player"


def test_axis_of_a_stage_with_several_devices_says_what_to_do() -> None:
    """It names all devices and the remedy; an axis that cannot play at all gives that reason."""
    axis = {"amplifier": {"device": "rig"}, "sensor": {"device": "rig"}, **LIMITED}
    mixed = {"amplifier": {"device": "rig"}, "sensor": {"device": "other"}, **LIMITED}
    simulated, names = {"driver": "simulated", "options": SimulatedOptions()}, ("rig", "other")
    config = DaemonConfig.model_validate(
        {
            "rate_hz": 100.0,
            "devices": dict.fromkeys(names, simulated),
            "axes": {"x": axis, "y": mixed},
        }
    )
    pairs = pairs_of(config.axes)
    devices = {name: SimulatedRig(SimulatedOptions(), wiring_of(name, pairs), 1) for name in names}
    channels = Channels(devices, pairs)
    channels.open()
    threads = play_thread.play_threads(config, channels, (), FakeClock(), Path("unused"))

    assert threads.refusal(0) == (
        "a play needs a stage with one device, because the loop pauses for it, and this one has "
        "other, rig: run axis x, with rig as its only device, from a configuration of its own, and "
        "its other devices from another one"
    )
    assert "measured by other: a record beside a play needs a sensor" in threads.refusal(1)
    channels.close()
