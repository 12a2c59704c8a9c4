"""The commands, faults and restarts of a soak, drawn from a seed."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from functools import partial
from math import pi, sin
from random import Random
from typing import Final

from piezod.client import AsyncStageClient
from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.errors import ClientError, RefusedError
from piezod.messages.answers import Status
from piezod.testing.injections import Injection
from piezod.units import NS_PER_S, s_to_ns
from tests.control.judged_device import SENSOR_LIES
from tests.control.own_output import OutputFault
from tests.soak.faults import FAULTS, LASTS_S, OUTPUT_FAULTS
from tests.soak.machine import Machine
from tests.soak.observer import Observer
from tests.soak.reach import bring_down

LOW_UM, HIGH_UM = 1.0, 25.0
RECOVERS_S: Final = 600.0
"""A stage can be armed again after this time without a disturbance, in s: a sensor with the wrong
sign lets it creep so far that S9 lasts for minutes at rest."""
LOOKS_S: Final = 60.0
PLAY_INTERVAL_S: Final = 0.02
MODE: Final = "adaptive"
OTHER_MODES: Final = ("feedforward", "trimmed", "uncompensated")


class Commands:
    """Operates a stage until a time has passed."""

    def __init__(
        self,
        machine: Machine,
        observer: Observer,
        seed: int,
        duration_s: float,
        ended: Callable[[], bool],
    ) -> None:
        self._machine, self._observer = machine, observer
        self._duration_s, self._ended = duration_s, ended
        self._draw = Random(seed)  # noqa: S311 - reproducible, not secret
        self._quiet_ns = self._ending_ns = 0
        self._mode, self._unknown = MODE, False
        self.killed = False
        """Whether the loop of the last daemon was killed."""
        self.done: Counter[str] = Counter()
        """How often each act was done."""
        self.refused: Counter[str] = Counter()
        """How often each act was refused."""
        self._acts: Mapping[Callable[[], Awaitable[None]], float] = {
            self._goto: 8,
            self._wave: 8,
            self._rest: 2,
            self._other_mode: 2,
            self._hold: 1,
            self._stop: 1,
            self._estop: 1,
            self._condition: 0.5,
            self._zero: 0.3,
            self._identify: 0.3,
            self._play: 0.7,
            self._parameters: 0.5,
            self._stream: 0.7,
            self._nonsense: 0.5,
            self._fault: 4,
            self._output_fault: 4,
            self._set_clock: 0.3,
            self._suspend: 0.3,
            self._stall: 0.5,
            self._restart: 0.2,
            self._kill: 0.2,
        }
        self._around = (
            *(self._goto, self._wave, self._stream, self._other_mode, self._hold, self._stop),
            *(self._play, self._play_and_kill),
            *(self._estop, self._condition, self._identify, self._rest_safe, self._safe_to_ready),
            *(self._stall, self._restart, self._kill),
        )

    @property
    def over(self) -> bool:
        """Whether it is time to end."""
        return self._ended() or self._machine.clock.elapsed_s >= self._duration_s

    @property
    def doubtful_end(self) -> bool:
        """Whether the output failed while the daemon ended: then it may say that it was lost."""
        return self._machine.rig.ends_ns(lies=False) >= self._ending_ns > 0

    async def __call__(self) -> None:
        """Operate the running daemon until it ends."""
        self._observer.new_daemon()
        self.killed = False
        self._disturb(0.0)
        machine = self._machine
        while machine.loop is None or not machine.paths.api_socket.exists():
            await asyncio.sleep(0.1)
        async with AsyncStageClient(socket=machine.paths.api_socket, name="soak") as self._stage:
            looking = asyncio.ensure_future(self._look())
            try:
                while not self.over and not looking.done():
                    await self._act()
                if looking.done():
                    looking.result()
                await self._end()
            finally:
                looking.cancel()

    async def _act(self) -> None:
        (act,) = self._draw.choices(list(self._acts), list(self._acts.values()))
        name = act.__name__.strip("_")
        await self._recover()
        self.done[name] += 1
        try:
            await act()
        except RefusedError as error:
            self._note(name, error)
        except ClientError as error:
            if self._machine.clock.t_ns > self._quiet_ns:
                raise RuntimeError(f"{name} got no answer") from error
            self.refused[name] += 1

    def _note(self, name: str, error: RefusedError) -> None:
        self.refused[name] += 1
        # D10 is reported in RUN only, and other states refuse to adapt.
        self._unknown |= "hysteresis is unknown" in str(error)

    async def _look(self) -> None:
        """Look at the stage from time to time, as a monitor does."""
        machine, observer = self._machine, self._observer
        assert machine.loop is not None
        connection = machine.loop.loop
        while True:
            await asyncio.sleep(LOOKS_S)
            machine.rig.end_faults(machine.clock.t_ns - s_to_ns(LOOKS_S))
            learned = connection.learned.read(0)
            if learned is not None:
                observer.learned(learned)
            try:
                await self._stage.status()
                await self._stage.metrics()
            except ClientError:
                if machine.clock.t_ns > self._quiet_ns:
                    raise

    async def _recover(self) -> None:
        """Bring the stage to READY or RUN, as docs/faults.md says."""
        clock = self._machine.clock
        end_ns = max(clock.t_ns, self._quiet_ns) + s_to_ns(RECOVERS_S)
        while True:
            status = await self._stage.status()
            if self._may_go_on(status):
                return
            if clock.t_ns > end_ns:
                present = ", ".join(fault.id for fault in status.faults)
                raise RuntimeError(
                    f"the stage stays in {status.state}, mode {status.mode}, "
                    f"with {present or 'no fault'}"
                )
            try:
                await self._step_from(status)
            except RefusedError as error:
                self._note("recover", error)
            await asyncio.sleep(1.0)

    def _may_go_on(self, status: Status) -> bool:
        # A fault may have degraded the mode.
        if status.mode != self._mode or self._unknown:
            return False
        return status.state in {State.READY, State.RUN}

    async def _step_from(self, status: Status) -> None:
        """Do the next thing that an operator would do."""
        match status.state:
            case State.SAFE:
                await self._stage.reset(engineer=True)
                await self._arm()
            case State.FAULT | State.ESTOP:
                await self._stage.reset(engineer=True)
            case State.READY if self._unknown:
                self._unknown = False
                await self._stage.condition()
                await self._ready_again()
            case State.RUN if self._unknown:
                await self._stop()
            case State.READY | State.RUN:
                if any(fault.latched for fault in status.faults):
                    await self._stage.reset(engineer=True)
                await self._stage.mode(self._mode)
            case State.HOLD:
                self._observer.asked(State.RAMP)
                await self._stage.stop()

    async def _arm(self) -> None:
        """Arm; where nothing tells the voltage, look at the amplifier once its faults are over."""
        try:
            await self._stage.arm()
        except RefusedError as error:
            if "--confirm-output" not in str(error) or self._machine.clock.t_ns <= self._quiet_ns:
                raise
            await self._stage.arm(confirm_output=True)

    # ------------------------------------------------------------------ acts

    async def _goto(self) -> None:
        await self._stage.goto(
            self._draw.uniform(LOW_UM, HIGH_UM), speed_um_per_s=self._draw.uniform(0.5, 5.0)
        )
        await asyncio.sleep(self._draw.uniform(2.0, 60.0))

    async def _wave(self) -> None:
        duration_s = await self._begin_wave()
        await asyncio.sleep(duration_s)

    async def _begin_wave(self) -> float:
        low_um, high_um = sorted(self._draw.uniform(LOW_UM, HIGH_UM) for _ in range(2))
        kind = self._draw.choice(("sine", "triangle"))
        duration_s = self._draw.uniform(20.0, 120.0)
        wave = {
            "kind": kind,
            "low": low_um,
            "high": max(high_um, low_um + 1.0),
            "frequency_hz": self._draw.uniform(0.02, 0.3),
        }
        await self._stage.wave({"x": wave}, duration_s)
        return duration_s

    async def _rest(self) -> None:
        await asyncio.sleep(self._draw.uniform(30.0, 300.0))

    async def _other_mode(self) -> None:
        self._mode = self._draw.choice(OTHER_MODES)
        try:
            await self._recover()
            await self._wave()
        finally:
            self._mode = MODE

    async def _hold(self) -> None:
        await self._begin_wave()
        await asyncio.sleep(5.0)
        self._observer.asked(State.HOLD)
        await self._stage.hold()
        await asyncio.sleep(self._draw.uniform(0.1, 3.0))
        await self._stage.resume()

    async def _stop(self) -> None:
        self._observer.asked(State.RAMP)
        await self._draw.choice((self._stage.stop, self._stage.disarm))()

    async def _estop(self) -> None:
        self._observer.asked(State.ESTOP, State.RAMP, State.FAULT, Fault.E1, within_s=20.0)
        await self._stage.estop()

    async def _condition(self) -> None:
        await self._safe_to_ready()
        await self._stage.condition()
        await self._ready_again()

    async def _zero(self) -> None:
        await self._safe_to_ready()
        # After a long movement this is half a micrometre, by which the model was right before.
        self._observer.taught(Fault.D1)
        await self._stage.zero()
        await asyncio.sleep(5.0)

    async def _identify(self) -> None:
        await self._safe_to_ready()
        wave = {"kind": "triangle", "low": 0.0, "high": 100.0, "frequency_hz": 0.2}
        await self._stage.identify({"x": wave}, 20.0)
        await self._ready_again()

    async def _play(self) -> None:
        """Play a table to its end, or stop it."""
        duration_s = await self._begin_play()
        if self._draw.random() < 0.5:
            await self._ready_again()
            return
        await asyncio.sleep(self._draw.uniform(0.0, duration_s))
        if self._draw.random() < 0.5:
            await self._draw.choice((self._stop, self._estop))()
        else:
            self._observer.asked(State.HOLD)
            await self._stage.hold()

    async def _play_and_kill(self) -> None:
        """Kill the loop while the device plays on."""
        await asyncio.sleep(self._draw.uniform(0.0, await self._begin_play()))
        await self._kill_now()

    async def _begin_play(self) -> float:
        """Begin a play; return its duration, in s. What it has done to the memory is not known."""
        await self._safe_to_ready()
        middle_v, swing_v = self._draw.uniform(30.0, 110.0), self._draw.uniform(5.0, 30.0)
        points, cycles = self._draw.randrange(100, 500), self._draw.randrange(1, 6)
        table_v = [middle_v + swing_v * sin(2.0 * pi * i / points) for i in range(points)]
        duration_s = points * cycles * PLAY_INTERVAL_S
        self._observer.asked(Fault.D10, within_s=duration_s + 60.0)
        await self._stage.play(table_v, interval_s=PLAY_INTERVAL_S, cycles=cycles)
        self._unknown = True
        return duration_s

    async def _safe_to_ready(self) -> None:
        await self._stop()
        await asyncio.sleep(5.0)
        await self._recover()

    async def _ready_again(self) -> None:
        """Wait for the end of IDENT."""
        while (await self._stage.status()).state == State.IDENT:
            await asyncio.sleep(1.0)

    async def _parameters(self) -> None:
        await self._stage.save_params()

    async def _stream(self) -> None:
        self._observer.asked(State.HOLD, within_s=90.0)
        position_um = self._draw.uniform(LOW_UM, HIGH_UM)

        async def setpoints() -> AsyncIterator[Mapping[str, float]]:
            nonlocal position_um
            for _ in range(self._draw.randrange(200, 1200)):
                step_um = self._draw.uniform(-0.1, 0.1)
                position_um = min(max(position_um + step_um, LOW_UM), HIGH_UM)
                yield {"x": position_um}
                await asyncio.sleep(0.05)

        await self._stage.stream(setpoints())

    async def _nonsense(self) -> None:
        await self._stage.goto(self._draw.choice((-1e3, 1e3)))

    async def _fault(self) -> None:
        await self._begin_wave()
        await asyncio.sleep(self._draw.uniform(0.0, 20.0))
        kind, value, flag = self._draw.choice(FAULTS)
        duration_s = self._draw.choice(LASTS_S)
        rig = self._machine.rig
        if kind in SENSOR_LIES:  # output, read-back and sensor never lie together
            await self._until_ns(rig.ends_ns(lies=False))
        now_ns = self._machine.clock.t_ns
        end_ns = now_ns + s_to_ns(duration_s)
        rig.schedule.append(Injection(kind, now_ns, end_ns, 0, value, flag))
        self.done[f"fault: {kind}"] += 1
        self._disturb(duration_s)
        await asyncio.sleep(self._draw.uniform(0.0, 30.0))

    async def _output_fault(self) -> None:
        """Let the output or its read-back fail around any command."""
        rig = self._machine.rig
        await self._until_ns(rig.ends_ns(lies=True))
        kind, value = self._draw.choice(OUTPUT_FAULTS)
        act, duration_s = self._draw.choice(self._around), self._draw.choice(LASTS_S)
        plays = act in {self._play, self._play_and_kill}  # which begin in SAFE
        delay_s = self._draw.uniform(0.0, 25.0 if plays else 6.0)
        start_ns = self._machine.clock.t_ns + s_to_ns(delay_s)
        rig.output.faults.append(OutputFault(kind, start_ns, start_ns + s_to_ns(duration_s), value))
        self._disturb(delay_s + duration_s)
        self._observer.output_faults += 1
        self.done.update((f"fault: {kind}", f"{act.__name__} with a fault of the output"))
        try:
            await act()
        except RefusedError as error:
            self._note("with a fault of the output", error)
        if self._draw.random() < 0.5:
            await self._bring_down()

    async def _rest_safe(self) -> None:
        """Rest in SAFE, where nothing is written."""
        await self._stop()
        await asyncio.sleep(self._draw.uniform(5.0, 30.0))

    async def _bring_down(self) -> None:
        """Bring the stage to its safe voltage once the output is right again."""
        await self._until_ns(self._machine.rig.ends_ns(lies=False))
        stop = self._draw.choice((self._stop, self._estop))
        await bring_down(self._machine, self._stage, stop, partial(self._note, "bring_down"))

    async def _until_ns(self, end_ns: float) -> None:
        while (left_ns := end_ns - self._machine.clock.t_ns) > 0:
            await asyncio.sleep(left_ns / NS_PER_S)

    async def _set_clock(self) -> None:
        self._disturb(1.0)
        self._machine.clock.wall_offset_ns += s_to_ns(self._draw.uniform(-1e5, 1e5))
        await asyncio.sleep(5.0)

    async def _suspend(self) -> None:
        """Let the machine sleep: CLOCK_BOOTTIME runs on, CLOCK_MONOTONIC stands still."""
        asleep_ns = s_to_ns(self._draw.uniform(1.0, 3600.0))
        self._disturb(1.0)
        self._machine.clock.boot_offset_ns += asleep_ns
        self._machine.clock.wall_offset_ns += asleep_ns
        await asyncio.sleep(5.0)

    async def _stall(self) -> None:
        """Stop supervisor and loop at once, as SIGSTOP does."""
        stall_s = self._draw.choice((0.03, 0.3, 1.5, 20.0))
        await self._begin_wave()
        self._disturb(stall_s)
        self._machine.stall_ns = s_to_ns(stall_s)
        await asyncio.sleep(5.0)

    async def _restart(self) -> None:
        await self._end()

    async def _end(self) -> None:
        """Shut down; the end of the daemon cancels this."""
        self._observer.asked(State.RAMP, State.STOPPING, within_s=30.0)
        self._disturb(5.0)
        self._ending_ns = self._machine.clock.t_ns
        await self._stage.shutdown()
        await asyncio.sleep(1000.0)

    async def _kill(self) -> None:
        await self._begin_wave()
        await asyncio.sleep(self._draw.uniform(0.0, 20.0))
        await self._kill_now()

    async def _kill_now(self) -> None:
        self._disturb(5.0)
        loop = self._machine.loop
        assert loop is not None
        self.killed = True
        loop.kill()
        await asyncio.sleep(1000.0)

    def _disturb(self, duration_s: float) -> None:
        """Expect faults for this time and some more."""
        until_ns = self._machine.clock.t_ns + s_to_ns(duration_s)
        self._quiet_ns = max(self._quiet_ns, until_ns + s_to_ns(30.0))
        self._observer.disturbed(until_ns)
