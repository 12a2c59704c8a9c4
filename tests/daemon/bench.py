"""A stage link over shared memory, without a loop."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from math import nan
from pathlib import Path
from typing import TypeVar, get_type_hints

from piezod.config.daemon import DaemonConfig
from piezod.config.drive_limits import DriveLimit
from piezod.config.faults import Fault
from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.stage.answer import Answer
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.peer import Peer
from piezod.daemon.stage.running_stage import RunningStage
from piezod.messages.endpoints import Role
from piezod.messages.stores import Reloaded
from piezod.telemetry.encoder import encode_axis
from piezod.telemetry.layout import Layout
from piezod.telemetry.record import AxisRecord
from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from tests.daemon.fake_loop import FakeLoop

PEER = Peer(os.getuid(), os.getpid(), "somebody", "test", Role.ENGINEER)
T = TypeVar("T")


class Bench:
    """A stage link over shared memory, without a loop."""

    def __init__(self, folder: Path, config: DaemonConfig, *, shadow: bool = False) -> None:
        self.paths = StagePaths("rig", folder / "runtime", folder / "state")
        self.paths.make_folders()
        self.config = config
        self.loop = self.connection()
        self.stopped: list[str] = []
        self.link = self.new_link(shadow=shadow)

    def new_link(
        self, *, shadow: bool = False, config_changed: Callable[[], bool] = bool
    ) -> RunningStage:
        """Make a stage link."""
        return RunningStage(
            self.paths,
            self.loop,
            stop=self.stopped.append,
            reload=self._reload,
            shadow=shadow,
            config_changed=config_changed,
        )

    def connection(self) -> LoopConnection:
        """Make the shared memory of a loop."""
        return LoopConnection(self.config, create(self.paths.loop_map, Layout.of(self.config)))

    def do(self, call: Callable[[RunningStage], Awaitable[T]], answer: Answer | None = None) -> T:
        """Call the link while a fake loop answers."""

        async def called() -> T:
            return await call(self.link)

        with FakeLoop(self.loop.shared, answer) as loop:
            result = asyncio.run(called())
        self.requests = loop.requests
        return result

    def record(
        self,
        state: State,
        present: int = 0,
        *,
        latched: int = 0,
        shadow: bool = False,
        **axis: float,
    ) -> None:
        """Write a record like a loop; numbers that are not given are NaN."""
        write_record(self.loop.shared, state, present, latched=latched, shadow=shadow, **axis)

    def reported(self) -> list[Fault]:
        """Return the faults that the supervisor reports to the loop."""
        self.link.report_faults()
        bits = self.loop.shared.words[Word.SUPERVISOR_FAULTS]
        return [fault for place, fault in enumerate(SUPERVISOR_FAULTS) if bits >> place & 1]

    async def _reload(self, peer: Peer) -> Reloaded:
        return Reloaded((f"by {peer.user}",))


def write_record(
    shared: SharedMap,
    state: State,
    present: int = 0,
    *,
    latched: int = 0,
    shadow: bool = False,
    **axis: float,
) -> None:
    """Write a record of a stage with one axis; numbers that are not given are NaN."""
    shared.words[Word.LOOP_STATE] = list(State).index(state)
    cycle = [1, 0, 0, 0, 0, 0, 0, present & (2**64 - 1), present >> 64]
    cycle += [latched & (2**64 - 1), latched >> 64, 0]
    numbers = [name for name, kind in get_type_hints(AxisRecord).items() if kind is float]
    record = AxisRecord(
        sample_ns=1,
        mode=Mode.ADAPTIVE,
        gate=GateReason.OPEN,
        on_target=True,
        motion=4,
        limited=DriveLimit.NONE,
        **{name: axis.get(name, nan) for name in numbers},
    )
    fields = [*cycle, list(State).index(state), shadow, True, *encode_axis(record)]
    RingWriter(shared).append(fields)
