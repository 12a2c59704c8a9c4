"""A stage whose emulated device plays behind a worker, in virtual time; its threads take turns."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.control.guard import Limits
from piezod.control.stage.playing import PlayOutcome
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.loop.play_thread import AxisPlayer, PlayThreads
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices import registry
from piezod.devices.interface import Device, Identity
from piezod.devices.played_axis import AxisTable, PlayedAxis
from piezod.devices.played_scan import PlayedScan
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.devices.wiring import pairs_of
from piezod.errors import DeviceError
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.units import NS_PER_S
from tests.control.rig_stage import ON_TIME, RigStage
from tests.daemon.waiting import eventually
from tests.drivers.modbus import play_bench as modbus_bench
from tests.drivers.play_bench import PlayBench
from tests.drivers.serial_line import lc400_play_bench, nv200_play_bench, pi_play_bench
from tests.drivers.serial_line.scripted_line import TestTime

FOLDER: Final = Path(__file__).parents[3] / "config" / "devices"
BENCHES: Final[dict[str, Callable[[], PlayBench]]] = {
    "labjack-t7": modbus_bench.play_bench,
    "pi-gcs2": lambda: pi_play_bench.play_bench(wave_end="holds"),
    "lc400": lc400_play_bench.play_bench,
    "psj-nv200": lambda: nv200_play_bench.play_bench(wave_end="holds"),
}
"""The emulated players, by the name of their configuration."""
RATE_HZ: Final = 50.0
MS: Final = 1_000_000
WHO: Final = Identity("maker", "model", "7", "1.0")
TOP_V: Final = 100.0
POINTS: Final = 200
PLAY: Final = rq.Play(
    drive_v=tuple(TOP_V * k / (POINTS - 1) for k in range(POINTS)), interval_s=0.0048, cycles=1
)
"""A ramp from rest to the top, in 0.96 s."""


def configured(name: str) -> DaemonConfig:
    """Return a shipped configuration without a model: these rigs are linear."""
    config = load_daemon(FOLDER / f"{name}.yaml", registry)
    safety = config.axes["x"].safety.model_copy(update={"ramp_v_per_s": 200.0})
    axis = config.axes["x"].model_copy(update={"model": None, "safety": safety})
    return config.model_copy(update={"rate_hz": RATE_HZ, "axes": {"x": axis}})


class BenchClock:
    """Implements `Clock` by the time of a bench; nobody sleeps."""

    def __init__(self, time: TestTime) -> None:
        self.now_ns = time.now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Fail: only the test advances the time."""
        raise AssertionError(f"slept until {t_ns} ns")


def no_scan(names: Sequence[str]) -> PlayedScan:
    """Refuse a scan: these tests have none."""
    raise DeviceError(f"no scan of {names}")


class PlayedByTest(PlayThreads):
    """Plays whose steps the test takes, in its own thread, while the worker has nothing to do."""

    def __init__(self, axis: PlayedAxis, bench: PlayBench) -> None:
        player = AxisPlayer(axis, WHO, Limits(0.0, 150.0, 1000.0), round(NS_PER_S / RATE_HZ))
        clock = BenchClock(bench.time)
        free, zero_um = (lambda: True), (lambda _axis: 0.0)
        super().__init__({0: player}, {}, free, zero_um, clock, Path(), no_scan)
        self.axis, self.aborted = axis, False
        self.end: PlayOutcome | None = None
        self.table: AxisTable | None = None

    def begin(self, axis: int, table: AxisTable) -> None:
        """Take the table."""
        assert axis == 0
        self.table = table

    def abort(self) -> None:
        """Note the request."""
        self.aborted = True

    def outcome(self) -> PlayOutcome | None:
        """Return the end that the test has given, once."""
        end, self.end = self.end, None
        return end


class OpenWorker(DeviceWorker):
    """A worker whose device is open already."""

    def open(self) -> Identity:
        """Return who it is."""
        return WHO


class PlayStage(RigStage):
    """A stage that is armed, with an emulated player behind a reconnecting wrapper and a worker.

    In each cycle the worker ends its rounds, unless the test blocks them.
    """

    def __init__(self, name: str) -> None:
        self.bench = BENCHES[name]()
        self.time = self.bench.time
        config = configured(name)
        pair = pairs_of(config.axes)["x"]
        axis = PlayedAxis("x", {pair.amplifier: self.bench.device}, {"x": pair})
        self.runner = PlayedByTest(axis, self.bench)
        self.blocked: Callable[[], bool] = lambda: False
        super().__init__(config, self._wrapped, holds=True, plays=self.runner)
        self.t_ns = self.time.t_ns
        self.until("SAFE")
        self.do(rq.Arm())

    def _wrapped(self, _: Device) -> Device:
        period_ns = round(NS_PER_S / RATE_HZ)
        link = ReconnectingDevice(
            self.bench.device, self.bench_identity(), first_wait_s=0.0005, longest_wait_s=0.001
        )
        worker = OpenWorker(link, BenchClock(self.time), period_ns, period_ns // 2, pause_s=0.0005)
        self.link, self.worker = link, worker
        link.thread.start()
        worker.thread.start()
        return worker

    def bench_identity(self) -> Identity:
        """Return the identity of the emulated device."""
        device = self.bench.device
        device.close()
        found = device.open()
        device.activate(self.time.t_ns)
        return found

    @property
    def in_force_v(self) -> float:
        """Voltage of the rig, in V."""
        (drive_v,) = self.bench.rig.drive_v
        return drive_v

    def cycle(self, timing: CycleTiming = ON_TIME) -> CycleRecord:
        """Run one cycle, and wait for the worker; return its record."""
        self.time.t_ns = max(self.time.t_ns, self.t_ns + self.period_ns)
        self.bench.emulator.due()
        self.t_ns = self.time.t_ns - self.period_ns
        record = super().cycle(timing)
        eventually(lambda: self.worker.idle or self.blocked())
        return record

    def play_to(self, drive_v: float) -> None:
        """Begin the play, and wait until its output has passed a voltage, in V."""
        self.do(PLAY)
        while self.runner.table is None:
            self.cycle()
        self.runner.axis.load(self.runner.table, self.time.t_ns)
        self.runner.axis.player.arm()
        self.runner.axis.player.start(self.time.t_ns)
        while self.in_force_v < drive_v:
            self.bench.wait(5 * MS)
            self.runner.axis.player.progress(self.time.t_ns)

    def stop_play(self) -> float:
        """Stop the stage; abort the play once, as its thread does; return the voltage it gives."""
        self.do(rq.Stop())
        assert self.runner.aborted
        drive_v = self.runner.axis.abort(self.time.t_ns)
        self.runner.end = PlayOutcome((drive_v,))
        return drive_v

    def until_down(self) -> None:
        """Run until the stage has been brought down, with or without a fault that stays."""
        for _ in range(500):
            if self.state in {"SAFE", "FAULT"}:
                return
            self.cycle()
        raise AssertionError(f"the stage stays in {self.state} at {self.in_force_v:g} V")

    def silence(self, *, silent: bool) -> None:
        """Lose all replies from now on, or none; then the device is there."""
        self.bench.line.absent = silent
        self.bench.line.change = (lambda _: b"") if silent else (lambda reply: reply)
        if not silent:
            eventually(lambda: self.link.there)

    def pull(self, *, pulled: bool) -> None:
        """Pull the cable, or plug it in again; then the device is there."""
        self.bench.line.absent = pulled
        self.bench.unplug(pulled=pulled)
        if not pulled:
            eventually(lambda: self.link.there)

    def close(self) -> None:
        """End the threads."""
        self.worker.close()
