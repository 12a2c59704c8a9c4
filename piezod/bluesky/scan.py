"""A scan as a flight: `piezod scan` carries it out, and its pixels are the rows."""

import asyncio
import json
import os
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Self

import numpy as np
from ophyd_async.core import SignalMetadata
from scanspec.core import Dimension, SnakedDimension
from scanspec.specs import Spec

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.motion import moving
from piezod.bluesky.recorded import Column
from piezod.config.scan import AnyScan, RasterScan, scan_from
from piezod.errors import ConfigError, DataError, RefusedError

_ENTRY: Final = "scan/pixels"
_ERROR: Final = "error_um"
_INTEGER: Final = np.dtype("i4").str
_NS: Final = np.dtype("i8").str
_LONGEST_LINE: Final = 1024 * 1024
_LAST_LINES: Final = 10


@dataclass(eq=False)
class Scan:
    """Lines, a raster or a stack to scan, for a flyer. At its end the stage is disarmed."""

    scan: Mapping[str, Any]  #: The `scan:` of a file of `piezod scan`.
    _pictures: tuple[str, ...] = field(default=(_ERROR,), init=False)
    _units: dict[str, str] = field(default_factory=dict, init=False)

    @classmethod
    def of(cls, spec: Spec[str], **more: Any) -> Self:
        """Return the scan of a scanspec.

        Args:
            spec: A line, or lines times a line, snaked or not; its axes are named as those of the
                stage. A constant duration is the time of a pixel; without one `more` has
                `lines_per_s`.
            more: Further keys of `scan:`, such as `mode`.

        Raises:
            RefusedError: If piezod has no such scan.
        """
        dimensions = spec.calculate()
        if len(dimensions) > 2:
            raise _refused(f"{len(dimensions)} dimensions, allowed: a line, or lines of one axis")
        fast = dimensions[-1]
        kind: dict[str, Any] = {"kind": "line", "repeats": 1}
        if len(dimensions) == 2:
            kind = {"kind": "raster", "slow": _span(dimensions[0])}
        kind |= {
            "fast": _span(fast),
            "sweeps": "snake" if isinstance(fast, SnakedDimension) else "forward",
        }
        duration_s = spec.duration()
        if isinstance(duration_s, float):
            turn_share = more.get("turn_share", RasterScan.model_fields["turn_share"].default)
            kind["lines_per_s"] = (1.0 - turn_share) / (len(fast) * duration_s)
        return cls({**kind, **more})

    async def prepare(self, link: ConnectedStage) -> None:
        """Check the scan; nothing moves.

        Raises:
            RefusedError: If it is not valid, an axis is unknown, or its range is exceeded.
            ClientError: If the daemon does not answer.
        """
        scan = self._scan()
        for span in scan.spans:
            if span.axis not in link.facts:
                known = f"axes: {', '.join(link.facts)}"
                raise RefusedError(f"no axis {span.axis}", known, "not_found")
            for um in (span.from_um, span.to_um):
                if why := link.facts[span.axis].why_not(um):
                    raise RefusedError(f"axis {span.axis}: {why}", code="value")
        self._units = {span.axis: link.facts[span.axis].ascii_unit for span in scan.spans}
        axes = (await link.daemon.config())["axes"]
        sensors = [axes.get(span.axis, {}).get("sensor") or {} for span in scan.spans]
        inputs = dict.fromkeys(x for each in sensors for x in each.get("beside", ()))
        self._pictures = tuple(inputs) if inputs and scan.mode is None else (_ERROR,)

    async def fly(self, link: ConnectedStage, file: Path, begun: asyncio.Event) -> None:
        """Run `piezod scan` with the lease of this process; it writes the file.

        Args:
            link: Connection to the stage.
            file: Where the pixels are written.
            begun: Set when the command has begun to scan, or to learn the scan.

        Raises:
            DataError: If the scan was refused, has failed, or was interrupted.
        """
        with TemporaryDirectory(prefix="piezod-") as folder:
            given = Path(folder) / "scan.yaml"
            given.write_text(json.dumps({"scan": dict(self.scan)}), encoding="utf-8")
            arguments = ("scan", str(given), "--live", "--json", "--out", str(file))
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "piezod", *arguments, "--socket", str(link.daemon.socket),
                stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE, limit=_LONGEST_LINE,
                env={**os.environ, "PIEZOD_PROGRESS": "json", "PIEZOD_CLIENT": link.daemon.name},
                start_new_session=True,  # Ctrl-C reaches the RunEngine, which decides
            )  # fmt: skip
            with moving(link, *(span.axis for span in self._scan().spans)):
                try:
                    text = await _followed(process, begun)
                except BaseException:
                    process.send_signal(signal.SIGINT)  # it brings the stage to its safe voltage
                    await process.wait()
                    raise
        if text is not None:
            raise DataError(f"{link.title}: the scan failed: {text}")

    def columns(self, recorded: Sequence[Column]) -> list[Column]:
        """Return the columns that its file has, in the order of time."""
        time = recorded[-1]
        stage, source = time.key.removesuffix("-t"), time.source.removesuffix("t_s")
        spans, none = self._scan().spans, SignalMetadata()
        units = [SignalMetadata(units=self._units.get(span.axis, "um")) for span in spans]

        def column(name: str, dataset: str, metadata: SignalMetadata, dtype: str) -> Column:
            path, origin = f"{_ENTRY}/{dataset}", f"{source}{dataset}"
            return Column(f"{stage}-{name}", path, origin, metadata, dtype)

        double = time.dtype
        return [
            *(
                column(span.axis, f"position_{span.axis}_um", unit, double)
                for span, unit in zip(spans, units, strict=True)
            ),
            *(
                column(each.removesuffix("_um"), each, units[0], double)
                if each == _ERROR
                else column(each, each, none, double)
                for each in self._pictures
            ),
            column("row", "row", none, _INTEGER),
            column("column", "column", none, _INTEGER),
            column("t", "first_ns", SignalMetadata(units="ns"), _NS),
        ]

    def _scan(self) -> AnyScan:
        try:
            return scan_from(self.scan)
        except ConfigError as error:
            raise RefusedError(f"not a scan: {error}", code="value") from error


async def _followed(process: Process, begun: asyncio.Event) -> str | None:
    """Read the progress of a command to its end; return why it failed, None if it did not.

    Its first activity is the rest before the scan; a further one shows that it was not refused.
    """
    text: list[str] = []
    told = 0
    assert process.stderr is not None  # noqa: S101 - it is a pipe
    while line := await process.stderr.readline():
        try:
            json.loads(line)
        except ValueError:
            text = [*text, line.decode(errors="replace").rstrip()][-_LAST_LINES:]
            continue
        told += 1
        if told > 1:
            begun.set()
    return "\n".join(text) if await process.wait() else None


def _span(dimension: Dimension[str]) -> dict[str, Any]:
    """Return the span of a line of a scanspec, whose points are the centres of pixels."""
    if len(dimension.axes()) > 1:
        raise _refused(f"axes {', '.join(dimension.axes())} that move together")
    (axis,) = dimension.axes()
    centres_um = dimension.midpoints[axis]
    steps_um = np.diff(centres_um)
    if not len(steps_um) or not np.allclose(steps_um, steps_um[0], rtol=1e-6):
        raise _refused(f"axis {axis} without even steps")
    half_um = 0.5 * float(steps_um[0])
    first_um, last_um = float(centres_um[0]), float(centres_um[-1])
    ends_um = {"from_um": first_um - half_um, "to_um": last_um + half_um}
    return {"axis": axis, **ends_um, "pixels": len(centres_um)}


def _refused(what: str) -> RefusedError:
    return RefusedError(f"no scan of piezod: {what}", "describe it by its `scan:`", "value")
