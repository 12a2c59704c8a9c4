"""The client for ordinary programs and scripts; `AsyncStageClient` is the same for asyncio."""

import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from piezod.client.arrival import Arrival, arrival, too_late
from piezod.client.calls import Call
from piezod.client.commands import StageCommands
from piezod.client.errors import ended, translated
from piezod.client.methods import SyncCaller
from piezod.client.places import check_socket, find_socket
from piezod.client.reports import StageReports
from piezod.client.results import StreamEnd, reader
from piezod.client.telemetry import Telemetry, TelemetryReader
from piezod.client.wire import (
    BASE_URL,
    NDJSON,
    STREAM,
    TELEMETRY,
    TIMEOUT_S,
    WAITING_RATE_HZ,
    check,
    headers,
    no_tls,
    read_answer,
    read_document,
    recording_path,
    setpoint_line,
    telemetry_query,
    whole_file,
)

ResultT = TypeVar("ResultT")


class StageClient(StageCommands, StageReports, SyncCaller):
    """A connection to the daemon of one stage; use it in a `with` statement.

    ::

        with StageClient() as stage:
            stage.arm()
            stage.mode("adaptive")
            stage.goto_and_wait(12.5)

    Not for several threads at a time. Every method raises ClientError, or one of its kinds, where
    the daemon cannot be reached or refuses.

    Args:
        stage: Name of the stage; left out: `PIEZOD_STAGE`, or the only one that runs.
        socket: Path of the daemon's socket, in place of a name.
        name: What the daemon calls this client. The lease belongs to user and name: with one of its
            own, a client shares it with no other; left out, with the user's shell and scripts.

    Raises:
        NotRunningError: If no daemon listens.
        NotAllowedError: If this user may not connect.
        AmbiguousStageError: If several do, and none is named.
    """

    def __init__(
        self, stage: str | None = None, *, socket: Path | None = None, name: str = ""
    ) -> None:
        self.socket = check_socket(socket or find_socket(stage))
        self.name = name
        import httpx

        self._http = httpx.Client(
            transport=httpx.HTTPTransport(uds=str(self.socket), verify=no_tls()),
            base_url=BASE_URL,
            headers=headers(self.name),
            timeout=TIMEOUT_S,
            trust_env=False,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; the stage goes on with what it does."""
        self._http.close()

    def call(self, call: Call[ResultT]) -> ResultT:
        """Carry out one call of `piezod.client.calls`."""
        with translated(self.socket):
            response = self._http.request(call.method, call.path, json=call.body)
        return read_answer(call, response)

    def goto_and_wait(
        self,
        position_um: float,
        *,
        axis: str | None = None,
        speed_um_per_s: float | None = None,
        timeout_s: float = 30.0,
    ) -> Arrival:
        """Move to a position, and return once it has been reached and held.

        Args:
            position_um: Where to, in µm.
            axis: Left out: the only one.
            speed_um_per_s: How fast, in µm/s; left out: as the configuration says.
            timeout_s: How long to wait at most, in s; the stage goes on after that.

        Raises:
            NotReachedError: If it is not reached, or not in time; the text says why.
            ClientError: As for every method.
        """
        begun_s = time.monotonic()
        motion = self.goto(position_um, axis=axis, speed_um_per_s=speed_um_per_s).motion
        with closing(self.telemetry(WAITING_RATE_HZ)) as intervals:
            while True:
                told = next(intervals)
                if there := arrival(told, motion, axis):
                    return there
                if time.monotonic() - begun_s > timeout_s:
                    raise too_late(told, axis, timeout_s)

    def telemetry(
        self, rate_hz: float = 10.0, axes: Sequence[str] = ()
    ) -> Generator[Telemetry, None, None]:
        """Yield what happens, interval by interval, until the generator is closed.

        Args:
            rate_hz: Intervals per second, 1 to 50.
            axes: Which axes; none: all of them.

        Raises:
            NotRunningError: If the daemon ends.
            ClientError: As for every method.
        """
        reader, query = TelemetryReader(), telemetry_query(rate_hz, axes)
        with (
            translated(self.socket),
            self._http.stream("GET", TELEMETRY, params=query) as response,
        ):
            if response.is_error:
                response.read()
            check(response)
            for line in response.iter_lines():
                if told := reader.feed(line):
                    yield told
        raise ended(self.socket)

    def stream(self, setpoints_um: Iterable[Mapping[str, float]]) -> StreamEnd:
        """Have the stage follow setpoints, each from the moment at which it is sent.

        The stage goes to HOLD as soon as they stop.

        Args:
            setpoints_um: Axis: position in µm; each should come at the instant it is meant for.
        """
        lines = map(setpoint_line, setpoints_um)
        with translated(self.socket):
            response = self._http.post(STREAM, content=lines, headers=NDJSON)
        return reader(StreamEnd)(read_document(response))

    def fetch_recording(self, name: str, file: Path) -> int:
        """Copy a recording; return its size in bytes.

        Args:
            name: As `recordings` tells it.
            file: Where to; what is there is replaced.

        Raises:
            OSError: If the file cannot be written.
            ClientError: As for every method.
        """
        with (
            translated(self.socket),
            self._http.stream("GET", recording_path(name)) as response,
        ):
            if response.is_error:
                response.read()
            check(response)
            with whole_file(file) as opened:
                for block in response.iter_bytes():
                    opened.write(block)
                return opened.tell()
