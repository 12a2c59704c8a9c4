"""Several stages of this machine as one: a request reaches all of them, or none keeps it."""

import time
from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

from piezod.client.arrival import Arrival, StartedMove
from piezod.client.calls import Call, Waveforms, command
from piezod.client.group_requests import GroupRequests
from piezod.client.places import groups_file
from piezod.client.stage_client import StageClient
from piezod.config.states import State
from piezod.errors import RefusedError
from piezod.messages.answers import Answer, Status
from piezod.messages.endpoints import ANSWER_WITHIN_S
from piezod.messages.stores import Recording

START_IN_S: Final = 1.0
"""Time until a common start, in s, if none is given."""
_SHORTEST_S: Final = 1e-3
"""Shortest duration of a waveform, in s."""


@dataclass(frozen=True, kw_only=True)
class GroupStart:
    """Movements of several stages that begin together."""

    start_s: float  #: The instant at which they begin, in s as `time.monotonic()`.
    answers: dict[str, Answer]  #: Answers of the stages, by name.
    #: What `wait` waits for, by name; nothing for tables.
    moves: Mapping[str, StartedMove] = field(default_factory=dict)


class StageGroup:
    """Clients of several stages of this machine; use it in a `with` statement.

    ::

        with StageGroup("raster") as group, group.session():
            group.arm()
            group.wave({"fast": {"x": triangle}, "slow": {"y": ramp}}, duration_s=10)

    If a stage does not carry out a request, the request is taken back on the others, and GroupError
    is raised. Requests towards safety (`hold`, `stop`, `disarm`, `estop`) are never taken back, and
    reach each stage even if another one hangs or has ended.

    Args:
        stages: Name of a group in the file of the groups, or the names of the stages.
        file: The file of the groups; None for `PIEZOD_GROUPS`, or the usual places.
        name: Name of this client, as in `StageClient`.

    Raises:
        ConfigError: If the file of the groups cannot be used, or has no such group.
    """

    def __init__(
        self, stages: str | Iterable[str], *, file: Path | None = None, name: str = ""
    ) -> None:
        if isinstance(stages, str):
            from piezod.messages.groups import stages_of

            self.group, self.stages = stages, stages_of(stages, file or groups_file())
        else:
            self.stages = tuple(stages)
            self.group = ", ".join(self.stages)
        self.name = name
        self._clients: dict[str, StageClient] = {}
        self._requests = GroupRequests(self.group, self.client)

    def __enter__(self) -> Self:
        # Slow; no command, least of all an emergency stop, shall wait for it later.
        import piezod.client.request_bodies  # noqa: F401 - the first command uses it

        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections; the stages continue."""
        for client in self._clients.values():
            client.close()
        self._clients.clear()

    def client(self, stage: str) -> StageClient:
        """Return the client of one stage, for requests to this stage alone.

        Raises:
            RefusedError: If the stage does not belong to the group.
            NotRunningError: If its daemon does not run.
        """
        if stage not in self.stages:
            what = f"stage {stage!r} is not in the group, which has {', '.join(self.stages)}"
            raise RefusedError(what, code="value")
        if stage not in self._clients:
            self._clients[stage] = StageClient(stage, name=self.name)
        return self._clients[stage]

    def status(self) -> dict[str, Status]:
        """Return the status of each stage."""
        return self._requests.each("status", self.stages, lambda _, client: client.status())

    # ------------------------------------------------------------------ all or none

    def arm(self, *, shadow: bool = False, confirm_output: bool = False) -> dict[str, Answer]:
        """Arm all stages, or disarm those that were armed for it; arguments as in `StageClient`."""
        call = command("arm", shadow=shadow, confirm_output=confirm_output)
        before = self._requests.prepare("arm", self.stages)
        return self._requests.all_or_none(
            "arm", before, lambda _, client: client.call(call), _disarm
        )

    def resume(self) -> dict[str, Answer]:
        """Continue on all stages after a hold, or hold all."""
        before = self._requests.prepare("resume", self.stages)
        return self._requests.all_or_none(
            "resume", before, lambda _, client: client.resume(), _hold
        )

    def goto(self, targets_um: Mapping[str, Mapping[str, float]]) -> GroupStart:
        """Move to positions, at the configured speeds, or hold.

        Args:
            targets_um: Stage: axis: target in µm. Stages without an entry get no request.
        """
        # A waveform that stays at the target: all axes of a stage begin in one request.
        command_um = {
            stage: {axis: {"kind": "setpoint", "level": um} for axis, um in axes.items()}
            for stage, axes in targets_um.items()
        }
        return self._follow("goto", command_um, _SHORTEST_S, None)

    def goto_and_wait(
        self, targets_um: Mapping[str, Mapping[str, float]], *, timeout_s: float | None = None
    ) -> dict[str, tuple[Arrival, ...]]:
        """Move to positions; return when all axes are on target. As `goto`, then `wait`."""
        return self.wait(self.goto(targets_um), timeout_s)

    def wave(
        self,
        command_um: Mapping[str, Waveforms],
        duration_s: float,
        *,
        start_in_s: float = START_IN_S,
    ) -> GroupStart:
        """Follow waveforms that begin at the same instant, or hold.

        Args:
            command_um: Stage: axis: position over time in µm, as in `StageClient.wave`. Stages
                without an entry get no request.
            duration_s: Duration of the waveforms, in s.
            start_in_s: Time until they begin, in s, at most 30; each axis must be at the start of
                its waveform by then.
        """
        return self._follow("wave", command_um, duration_s, start_in_s)

    def wait(
        self, started: GroupStart, timeout_s: float | None = None
    ) -> dict[str, tuple[Arrival, ...]]:
        """Return when `goto` or `wave` is done on all stages.

        Meanwhile the leases are kept. If a stage is stopped, has a fault, does not answer, or
        belongs to another client now, the others hold.

        Args:
            started: What `goto` or `wave` has returned.
            timeout_s: Longest time to wait, in s; after that the stages continue. None for the time
                that the movements take, and 30 s (1 s after waveforms, which are done then).

        Raises:
            GroupError: If not all stages have arrived.
            RefusedError: For a table, which has no position.
        """
        from piezod.client.group_wait import wait_for  # slow; no command shall wait for it

        if not started.moves:
            raise RefusedError("a table arrives nowhere", "ask `played` of each client", "value")
        found = wait_for(started.moves, self.name, timeout_s)
        if found.failed:
            self._requests.end("the movement", started.moves, found.failed)
        return found.done

    def play(
        self, tables: Mapping[str, Mapping[str, Any]], *, start_in_s: float = START_IN_S
    ) -> GroupStart:
        """Let devices play tables that begin at the same instant, or hold.

        Args:
            tables: Stage: arguments of `StageClient.play`. Stages without an entry get no request.
            start_in_s: Time until they begin, in s, at most 30; each device must have its table by
                then.
        """
        calls = {stage: command("play", **table) for stage, table in tables.items()}
        return self._begin("play", calls, start_in_s)

    def _follow(
        self,
        verb: str,
        command_um: Mapping[str, Waveforms],
        duration_s: float,
        start_in_s: float | None,
    ) -> GroupStart:
        calls = {
            stage: command("wave", command_um=waveforms, duration_s=duration_s)
            for stage, waveforms in command_um.items()
        }
        started = self._begin(verb, calls, start_in_s)
        waves = verb == "wave"
        moves = {
            stage: StartedMove(answer, tuple(command_um[stage]), follows_waves=waves)
            for stage, answer in started.answers.items()
        }
        return replace(started, moves=moves)

    def _begin(
        self, verb: str, calls: Mapping[str, Call[Answer]], start_in_s: float | None
    ) -> GroupStart:
        before = self._requests.prepare(verb, calls)
        start_s = time.monotonic() + (start_in_s or 0.0)
        common = {} if start_in_s is None else {"start_s": start_s}

        def begin(stage: str, client: StageClient) -> Answer:
            call = calls[stage]
            return client.call(replace(call, body={**(call.body or {}), **common}))

        answers = self._requests.all_or_none(verb, before, begin, _hold)
        return GroupStart(start_s=start_s, answers=answers)

    def start_recording(
        self, label: str | None = None, *, start_in_s: float = START_IN_S
    ) -> dict[str, Recording]:
        """Start a recording of each stage; time 0 of all files is the same instant.

        Args:
            label: Becomes part of the names.
            start_in_s: Time until the first recorded cycle, in s, at most 30.
        """
        before = self._requests.prepare("record start", self.stages)
        start_s = time.monotonic() + start_in_s

        def start(_: str, client: StageClient) -> Recording:
            return client.start_recording(label, start_s=start_s)

        return self._requests.all_or_none("record start", before, start, _end_recording)

    @contextmanager
    def session(self) -> Generator[None, None, None]:
        """Return a context manager that binds all stages to this client, as in `StageClient`."""
        self._requests.prepare("session", self.stages)
        with ExitStack() as sessions:
            for stage in self.stages:
                sessions.enter_context(self.client(stage).session())
            yield

    # ------------------------------------------------------------------ never taken back

    def stop_recording(self) -> dict[str, Recording]:
        """End the recordings of all stages."""
        return self._requests.each(
            "record stop", self.stages, lambda _, client: client.stop_recording(), ANSWER_WITHIN_S
        )

    def hold(self) -> dict[str, Answer]:
        """Hold the voltages of all stages."""
        return self._requests.each("hold", self.stages, lambda _, client: client.hold())

    def disarm(self) -> dict[str, Answer]:
        """Ramp all stages to their safe voltages, then SAFE."""
        return self._requests.each("disarm", self.stages, lambda _, client: client.disarm())

    def stop(self) -> dict[str, Answer]:
        """Ramp all stages to their safe voltages, then SAFE."""
        return self._requests.each("stop", self.stages, lambda _, client: client.stop())

    def estop(self) -> dict[str, Answer]:
        """Stop all stages in an emergency, as configured."""
        return self._requests.each("estop", self.stages, lambda _, client: client.estop())


def _disarm(client: StageClient, before: Status) -> str:
    if before.state != State.SAFE:  # it was armed already
        return ""
    client.disarm()
    return "disarmed"


def _hold(client: StageClient, _before: Status) -> str:
    client.hold()
    return "held"


def _end_recording(client: StageClient, _before: Status) -> str:
    client.stop_recording()
    return "recording ended"
