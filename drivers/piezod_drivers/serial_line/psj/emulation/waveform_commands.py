"""The commands of the waveform generator and of the data recorder of an emulated NV200/D."""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Final

from piezod_drivers.serial_line.psj.emulation.waveforms import (
    N_CHANNELS,
    N_POINTS,
    N_SAMPLES,
    Waveforms,
)

_MOST: Final = 65_535
_SOURCES: Final = range(8)
_LINE_NS: Final = 1_000_000
"""Time that a request for a sample takes at least on a line of 115,200 baud."""


class WrongValueError(Exception):
    """Raised for values that a command refuses; its argument names the refusal."""


class WaveformCommands:
    """Carries out the commands.

    Args:
        waveforms: Generator and recorder.
    """

    def __init__(self, waveforms: Waveforms) -> None:
        self._waveforms = waveforms
        indices = range(N_POINTS)
        self.handlers: dict[str, Callable[[Sequence[str]], str | None]] = {
            "modsrc": self._number("source", range(4), waveforms.set_source),
            "goarb": self._number("first", indices),
            "gsarb": self._number("loop", indices),
            "gearb": self._number("last", indices),
            "gcarb": self._number("cycles", range(_MOST + 1)),
            "gtarb": self._number("factor", range(1, _MOST + 1)),
            "giarb": lambda _: str(max(waveforms.index, 0)),
            "gbarb": self._point,
            "grun": self._number("running", range(2), lambda on: waveforms.run(on=bool(on))),
            "recsrc": self._source,
            "recast": self._number("starts", range(3)),
            "recstr": self._number("stride", range(1, _MOST + 1)),
            "reclen": self._number("length", range(N_SAMPLES + 1)),
            "recrun": self._number("recording", range(2), lambda on: waveforms.record(on=bool(on))),
            "recidx": lambda _: str(len(waveforms.rows)),
            "recout": self._sample,
            "recoutf": self._samples,
        }

    def _number(
        self, name: str, allowed: range, change: Callable[[int], None] | None = None
    ) -> Callable[[Sequence[str]], str | None]:
        """Return the handler of a command that sets or returns a whole number."""

        def handle(values: Sequence[str]) -> str | None:
            if not values:
                return str(int(getattr(self._waveforms, name)))
            _check_count(values, 1)
            value = _whole(values[0], allowed)
            if change is None:
                setattr(self._waveforms, name, value)
            else:
                change(value)
            return None

        return handle

    def _point(self, values: Sequence[str]) -> str | None:
        """Set or return a point of the waveform, in %, with three decimals."""
        _check_count(values, 2)
        index = _whole(values[0] if values else "", range(N_POINTS))
        if len(values) == 1:
            return f"{index},{self._waveforms.percent[index]:.3f}"
        percent = _float(values[1])
        if not 0 <= percent <= 100:
            raise WrongValueError("range")
        self._waveforms.percent[index] = round(percent, 3)
        return None

    def _source(self, values: Sequence[str]) -> str | None:
        _check_count(values, 2)
        channel = _whole(values[0] if values else "", range(N_CHANNELS))
        if len(values) == 1:
            return f"{channel},{self._waveforms.sources[channel]}"
        self._waveforms.sources[channel] = _whole(values[1], _SOURCES)
        return None

    def _sample(self, values: Sequence[str]) -> str:
        """Return one sample: of a channel, at an index."""
        _check_count(values, 3)
        if len(values) < 3:
            raise WrongValueError("missing")
        channel, index = _whole(values[0], range(N_CHANNELS)), _whole(values[1], range(N_SAMPLES))
        self._waveforms.advance(_LINE_NS)  # a client asks at once for what was recorded meanwhile
        rows = self._waveforms.rows
        return f"{channel},{index},{rows[index][channel] if index < len(rows) else 0.0:.3f}"

    def _samples(self, values: Sequence[str]) -> str:
        """Return all samples of a channel."""
        _check_count(values, 1)
        channel = _whole(values[0] if values else "", range(N_CHANNELS))
        return ",".join([str(channel), *(f"{row[channel]:.3f}" for row in self._waveforms.rows)])


def _check_count(values: Sequence[str], most: int) -> None:
    if len(values) > most:
        raise WrongValueError("many")


def _whole(text: str, allowed: range) -> int:
    value = _float(text)
    if int(value) not in allowed:
        raise WrongValueError("range")
    return int(value)


def _float(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise WrongValueError("missing") from None
    if not isfinite(value):
        raise WrongValueError("range")
    return value
