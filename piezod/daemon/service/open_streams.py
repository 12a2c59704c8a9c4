"""The setpoint streams in progress, at most one for each axis."""

from collections.abc import Iterable, Sequence

from piezod.daemon.service.refusals import SupersededError
from piezod.messages.endpoints import Group
from piezod.messages.requests import TABLE, Request


class OpenStream:
    """A stream in progress, until another request commands one of its axes.

    Args:
        axes: Names of its axes.
    """

    def __init__(self, axes: Iterable[str]) -> None:
        self.axes = frozenset(axes)
        self.superseded = ""
        """What took over, for people; empty while the stream has all its axes."""

    def check(self) -> None:
        """Check that the stage still follows this stream.

        Raises:
            SupersededError: If another request has taken over.
        """
        if self.superseded:
            raise SupersededError(self.superseded, "start a new stream for further setpoints")


class OpenStreams:
    """All streams in progress; the newest request for an axis ends the stream of that axis."""

    def __init__(self) -> None:
        self._streams: set[OpenStream] = set()

    def open(self, axes: Iterable[str]) -> OpenStream:
        """Add a stream whose request the loop has accepted."""
        stream = OpenStream(axes)
        self._streams.add(stream)
        return stream

    def close(self, stream: OpenStream) -> None:
        """Remove a stream that has ended; a second call does nothing."""
        self._streams.discard(stream)

    def supersede(self, axes: Iterable[str], by: str) -> None:
        """End the streams of these axes.

        Args:
            axes: Names of the axes.
            by: The request that commands them from now on, and its user, for people.
        """
        for stream in self._streams:
            if shared := sorted(stream.axes.intersection(axes)):
                stream.superseded = f"{by} has taken over {', '.join(shared)}"
        self._streams = {stream for stream in self._streams if not stream.superseded}


def commanded_axes(request: Request, all_axes: Sequence[str]) -> Sequence[str]:
    """Return the axes that no longer follow their stream when a request was accepted."""
    row = TABLE[request.kind]
    if row.group is not Group.MOVE and not row.access.urgent:
        return ()
    named = getattr(request, "axes", None) or getattr(request, "command_um", None)
    axis = getattr(request, "axis", None)
    return tuple(named or ((axis,) if axis else all_axes))
