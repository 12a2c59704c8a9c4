"""The client for programs under asyncio; `StageClient` is the one for all others."""

from collections.abc import AsyncGenerator, AsyncIterable, AsyncIterator, Mapping, Sequence
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypeVar

from piezod.client.arrival import Arrival, Arriving, StartedMove, refuse_without_sensor
from piezod.client.calls import Call
from piezod.client.commands import StageCommands
from piezod.client.errors import translated
from piezod.client.methods import AsyncCaller
from piezod.client.place import find_place
from piezod.client.reader import LineSplitter, TelemetryReader, read
from piezod.client.reports import StageReports
from piezod.client.wire import (
    SESSION,
    STREAM,
    WAITING_RATE_HZ,
    check,
    http_request,
    is_error,
    pool_options,
    read_answer,
    read_document,
    recording_path,
    request_of,
    setpoint_line,
    telemetry_path,
    whole_file,
)
from piezod.messages.answers import StreamEnd
from piezod.messages.documents import Document
from piezod.messages.telemetry import Telemetry

if TYPE_CHECKING:
    import httpcore

ResultT = TypeVar("ResultT")


class AsyncStageClient(StageCommands, StageReports, AsyncCaller):
    """A connection to the daemon of one stage; use it in an `async with` statement.

    ::

        async with AsyncStageClient() as stage:
            await stage.arm()
            await stage.mode("adaptive")
            await stage.goto_and_wait(12.5)

    Several tasks of one event loop may use it at the same time. Every method raises ClientError,
    or a subclass, if it cannot reach the daemon or the daemon refuses.

    Args:
        stage: Name of the stage, or its address at `piezod web` of another machine; None for
            `PIEZOD_STAGE`, or the only stage that runs.
        socket: Path of the daemon's socket, in place of a name.
        name: Name of this client, up to 64 letters, digits and _.:@-. The lease belongs to user and
            name: clients of one user without a name, such as shell and scripts, share it.

    Attributes:
        place: Where the daemon is reached.
        socket: Its socket; None on another machine.

    Raises:
        NotRunningError: If no daemon listens.
        ClientError: If the token or the certificate of an address cannot be used.
        NotAllowedError: If this user may not connect.
        AmbiguousStageError: If several daemons listen and no stage is named.
    """

    def __init__(
        self, stage: str | None = None, *, socket: Path | None = None, name: str = ""
    ) -> None:
        self.place = find_place(stage, socket)
        self.socket = self.place.socket
        self.name = name
        import httpcore  # slow; `import piezod.client` shall not wait for it

        from piezod.client.own_connection import AsyncBackend, PoolOfProcess

        self._pool = PoolOfProcess(
            lambda: httpcore.AsyncConnectionPool(
                **pool_options(self.place), network_backend=AsyncBackend()
            )
        )

    async def __aenter__(self) -> Self:
        # Slow; no command, least of all an emergency stop, shall wait for it later.
        import piezod.client.request_bodies  # noqa: F401 - the first command uses it

        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection; the stage continues."""
        await self._pool.close().aclose()

    @property
    def _http(self) -> "httpcore.AsyncConnectionPool":
        return self._pool.get()

    async def call(self, call: Call[ResultT]) -> ResultT:
        """Send one call and return its result; all other methods use this one."""
        with translated(self.place):
            response = await self._http.request(**request_of(call, self.name, self.place))
        return read_answer(call, response)

    async def goto_and_wait(
        self,
        position_um: float,
        *,
        axis: str | None = None,
        speed_um_per_s: float | None = None,
        timeout_s: float | None = None,
    ) -> Arrival:
        """Move to a position; return when it has been within its tolerance for the settling time.

        Args:
            position_um: Target, in µm.
            axis: Name of the axis; None for the only axis.
            speed_um_per_s: Speed, in µm/s; None for the configured speed.
            timeout_s: Longest time to wait, in s; after that the stage continues. None for the time
                that the movement takes, and 30 s.

        Raises:
            NotReachedError: If the movement ends before its target or takes too long; the text
                has the reason.
            RefusedError: If the axis has no sensor; then nothing moves.
            ClientError: As in every method.
        """
        refuse_without_sensor(await self.status(), axis)
        answer = await self.goto(position_um, axis=axis, speed_um_per_s=speed_um_per_s)
        return (await self._arrive(StartedMove(answer, (axis,) if axis else ()), timeout_s))[0]

    async def path_and_wait(
        self,
        points: Sequence[Mapping[str, float]],
        *,
        speed_per_s: float | None = None,
        timeout_s: float | None = None,
    ) -> tuple[Arrival, ...]:
        """Move user axes through points; return when all are on target.

        Args:
            points: As for `path`.
            speed_per_s: As for `path`.
            timeout_s: As for `goto_and_wait`.

        Raises:
            NotReachedError: As for `goto_and_wait`.
            ClientError: As in every method.
        """
        answer = await self.path(points, speed_per_s=speed_per_s)
        axes = tuple(dict.fromkeys(name for point in points for name in point))
        return await self._arrive(StartedMove(answer, axes), timeout_s)

    async def _arrive(self, move: StartedMove, timeout_s: float | None) -> tuple[Arrival, ...]:
        """Return where the axes of a movement have arrived, when all of them have."""
        arriving = Arriving(move, timeout_s)
        async with aclosing(self.telemetry(WAITING_RATE_HZ)) as intervals:
            async for interval in intervals:
                if arrived := arriving.feed(interval):
                    return arrived
        raise self.place.ended()

    async def telemetry(
        self, rate_hz: float = 10.0, axes: Sequence[str] = ()
    ) -> AsyncGenerator[Telemetry, None]:
        """Yield the telemetry of each interval, until the generator is closed.

        Args:
            rate_hz: Intervals per second, 1 to 50.
            axes: Names of the axes; all axes if empty.

        Raises:
            NotRunningError: If the daemon ends.
            ClientError: As in every method.
        """
        reader, lines = TelemetryReader(), LineSplitter()
        async with self._streamed("GET", telemetry_path(rate_hz, axes)) as response:
            async for block in response.aiter_stream():
                for line in lines.feed(block):
                    if interval := reader.feed(line):
                        yield interval
        raise self.place.ended()

    @asynccontextmanager
    async def session(self) -> AsyncGenerator[None, None]:
        """Return a context manager that binds the stage to this client.

        In the block this client has the lease. When the block or the process ends, in whatever way,
        the daemon stops the stage and ends a recording that this client has started.

        Raises:
            RefusedError: If another client has the lease, or another process has a session.
            ClientError: As in every method.
        """
        async with self._streamed("POST", SESSION, body={}):
            yield

    async def stream(self, setpoints_um: AsyncIterable[Mapping[str, float]]) -> StreamEnd:
        """Let the stage follow setpoints; each takes effect when it is sent.

        The stage goes to HOLD when the setpoints end.

        Args:
            setpoints_um: Axis: position in µm; the iterable yields each setpoint at its time.
        """
        lines = (setpoint_line(each) async for each in setpoints_um)
        with translated(self.place):
            request = http_request("POST", STREAM, self.name, lines=lines, place=self.place)
            response = await self._http.request(**request)
        return read(StreamEnd, read_document(response))

    async def fetch_recording(self, name: str, file: Path) -> int:
        """Copy a recording; return its size in bytes.

        Args:
            name: Name in `recordings`.
            file: File to write; an existing one is replaced.

        Raises:
            OSError: If the file cannot be written.
            ClientError: As in every method.
        """
        async with self._streamed("GET", recording_path(name)) as response:
            return await _save(response, file)

    @asynccontextmanager
    async def _streamed(
        self, method: str, path: str, body: Document | None = None
    ) -> AsyncIterator["httpcore.Response"]:
        """Send a request; give its answer, to be read piece by piece, unless it is an error."""
        request = http_request(method, path, self.name, body=body, place=self.place)
        with translated(self.place):
            async with self._http.stream(**request) as response:
                if is_error(response):
                    await response.aread()
                check(response)
                yield response


async def _save(response: "httpcore.Response", file: Path) -> int:
    """Write a body that arrives piece by piece into a file; return its size in bytes."""
    with whole_file(file) as opened:
        async for block in response.aiter_stream():
            opened.write(block)
        return opened.tell()
