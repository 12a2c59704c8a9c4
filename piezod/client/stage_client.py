"""The client for scripts and other programs; `AsyncStageClient` is the one for asyncio."""

import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

from piezod.client.arrival import Arrival, arrival, longest_wait_s, refuse_without_sensor, too_late
from piezod.client.calls import Call
from piezod.client.commands import StageCommands
from piezod.client.errors import translated
from piezod.client.methods import SyncCaller
from piezod.client.place import find_place
from piezod.client.reader import read
from piezod.client.reports import StageReports
from piezod.client.telemetry import LineSplitter, TelemetryReader
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


class StageClient(StageCommands, StageReports, SyncCaller):
    """A connection to the daemon of one stage; use it in a `with` statement.

    ::

        with StageClient() as stage:
            stage.arm()
            stage.mode("adaptive")
            stage.goto_and_wait(12.5)

    A client must not be used by several threads at the same time. Every method raises ClientError,
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

        from piezod.client.own_connection import Backend, PoolOfProcess

        self._pool = PoolOfProcess(
            lambda: httpcore.ConnectionPool(**pool_options(self.place), network_backend=Backend())
        )

    def __enter__(self) -> Self:
        # Slow; no command, least of all an emergency stop, shall wait for it later.
        import piezod.client.request_bodies  # noqa: F401 - the first command uses it

        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; the stage continues."""
        self._pool.close().close()

    @property
    def _http(self) -> "httpcore.ConnectionPool":
        return self._pool.get()

    def call(self, call: Call[ResultT]) -> ResultT:
        """Send one call and return its result; all other methods use this one."""
        with translated(self.place):
            response = self._http.request(**request_of(call, self.name, self.place))
        return read_answer(call, response)

    def goto_and_wait(
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
        refuse_without_sensor(self.status(), axis)
        start_s = time.monotonic()
        answer = self.goto(position_um, axis=axis, speed_um_per_s=speed_um_per_s)
        longest_s = longest_wait_s(answer) if timeout_s is None else timeout_s
        with closing(self.telemetry(WAITING_RATE_HZ)) as intervals:
            while True:
                interval = next(intervals)
                if arrived := arrival(interval, answer.motion, axis):
                    return arrived
                if time.monotonic() - start_s > longest_s:
                    raise too_late(interval, axis, longest_s)

    def telemetry(
        self, rate_hz: float = 10.0, axes: Sequence[str] = ()
    ) -> Generator[Telemetry, None, None]:
        """Yield the telemetry of each interval, until the generator is closed.

        Args:
            rate_hz: Intervals per second, 1 to 50.
            axes: Names of the axes; all axes if empty.

        Raises:
            NotRunningError: If the daemon ends.
            ClientError: As in every method.
        """
        reader, lines = TelemetryReader(), LineSplitter()
        with self._streamed("GET", telemetry_path(rate_hz, axes)) as response:
            for block in response.iter_stream():
                for line in lines.feed(block):
                    if interval := reader.feed(line):
                        yield interval
        raise self.place.ended()

    @contextmanager
    def session(self) -> Generator[None, None, None]:
        """Return a context manager that binds the stage to this client.

        In the block this client has the lease. When the block or the process ends, in whatever way,
        the daemon stops the stage and ends a recording that this client has started.

        Raises:
            RefusedError: If another client has the lease, or another process has a session.
            ClientError: As in every method.
        """
        with self._streamed("POST", SESSION, body={}):
            yield

    def stream(self, setpoints_um: Iterable[Mapping[str, float]]) -> StreamEnd:
        """Let the stage follow setpoints; each takes effect when it is sent.

        The stage goes to HOLD when the setpoints end.

        Args:
            setpoints_um: Axis: position in µm; the iterable yields each setpoint at its time.
        """
        lines = map(setpoint_line, setpoints_um)
        with translated(self.place):
            response = self._http.request(
                **http_request("POST", STREAM, self.name, lines=lines, place=self.place)
            )
        return read(StreamEnd, read_document(response))

    def fetch_recording(self, name: str, file: Path) -> int:
        """Copy a recording; return its size in bytes.

        Args:
            name: Name in `recordings`.
            file: File to write; an existing one is replaced.

        Raises:
            OSError: If the file cannot be written.
            ClientError: As in every method.
        """
        with (
            self._streamed("GET", recording_path(name)) as response,
            whole_file(file) as opened,
        ):
            for block in response.iter_stream():
                opened.write(block)
            return opened.tell()

    @contextmanager
    def _streamed(
        self, method: str, path: str, body: Document | None = None
    ) -> Iterator["httpcore.Response"]:
        """Send a request; give its answer, to be read piece by piece, unless it is an error."""
        request = http_request(method, path, self.name, body=body, place=self.place)
        with translated(self.place), self._http.stream(**request) as response:
            if is_error(response):
                response.read()
            check(response)
            yield response
