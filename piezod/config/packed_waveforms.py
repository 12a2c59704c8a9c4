"""Waveforms as they reach the loop: drawn, bounded and packed, so that the loop builds nothing.

The supervisor packs the waveforms of a request. Random paths become points, and long paths become
arrays of doubles, which the loop takes over with one copy. Everything else is small, and its amount
is limited.
"""

from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from pydantic import BaseModel

from piezod.config.combined_waveforms import Sequence, SequencePart, Sum, WaveformConfig
from piezod.config.envelopes import ConstantEnvelope, DecayingEnvelope, ModulatedEnvelope
from piezod.config.files import Point
from piezod.config.random_path import random_path
from piezod.config.waveforms import (
    Bounds,
    Component,
    Csv,
    Multisine,
    Points,
    Reversals,
    Setpoint,
    Sine,
    Staircase,
    Triangle,
)
from piezod.errors import PiezodError

MAX_POINTS: Final = 16_000
"""Most points, levels and turning points in the waveforms of a request: they fill its mailbox."""
MAX_TERMS: Final = 128
"""Most sinusoids and other parts in the waveforms of a request: they are summed in every cycle."""

Packed: TypeAlias = dict[str, Any]
"""A waveform of plain values, bytes, tuples and dicts."""


class WaveformCostError(PiezodError):
    """Raised if waveforms are too large for the loop.

    Args:
        what: The limit.
        remedy: What the user can do.
    """

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}: {remedy}")
        self.what, self.remedy = what, remedy


@dataclass(frozen=True, slots=True)
class PackedPath:
    """Points joined by straight lines, or levels one after the other.

    Attributes:
        times_s: Times of the points in s; of levels, the times at which one follows another.
        levels: Levels.
        low: Lowest level.
        high: Highest level.
        stepped: Whether each level is held until the next.
    """

    times_s: "array[float]"
    levels: "array[float]"
    low: float
    high: float
    stepped: bool

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        return self.low, self.high


LoopWaveform: TypeAlias = WaveformConfig | PackedPath
"""A waveform as the loop gets it."""


def pack_waveforms(waveforms: Mapping[str, WaveformConfig], duration_s: float) -> dict[str, Packed]:
    """Return the waveforms of a request, packed.

    Args:
        waveforms: Waveforms by axis.
        duration_s: Longest time that will be evaluated, in s.

    Raises:
        WaveformCostError: If they are too large for the loop.
    """
    packer = _Packer()
    return {axis: packer.pack(config, duration_s) for axis, config in waveforms.items()}


class _Packer:
    """Packs waveforms, and counts their points and terms."""

    def __init__(self) -> None:
        self._points = self._terms = 0

    def pack(self, config: WaveformConfig, duration_s: float) -> Packed:
        match config:
            case Reversals(low=low, high=high):
                room = MAX_POINTS - self._points
                path = random_path(config, duration_s, most_points=room + 1)
                return self._lines(path, (low, high))
            case Points(points=points) | Csv(points=points):
                return self._lines(points, config.bounds())
            case Staircase(levels=levels, dwell_s=dwell_s):
                edges_s = (dwell_s * count for count in range(1, len(levels)))
                return self._path(edges_s, levels, config.bounds(), stepped=True)
            case Sum(parts=parts):
                return {"kind": "sum", "parts": [self.pack(part, duration_s) for part in parts]}
            case Sequence(parts=parts):
                return {
                    "kind": "sequence",
                    "parts": [self._part(part, duration_s) for part in parts],
                }
            case _:
                self._count_terms(len(config.components) if isinstance(config, Multisine) else 1)
                return config.model_dump()

    def _part(self, part: SequencePart, duration_s: float) -> Packed:
        packed = self.pack(part.waveform, min(part.duration_s, duration_s))
        return {"duration_s": part.duration_s, "waveform": packed}

    def _lines(self, points: Iterable[Point], bounds: Bounds) -> Packed:
        times_s, levels = zip(*points, strict=True)
        return self._path(times_s, levels, bounds)

    def _path(
        self,
        times_s: Iterable[float],
        levels: Iterable[float],
        bounds: Bounds,
        *,
        stepped: bool = False,
    ) -> Packed:
        packed_levels = array("d", levels)
        self._points += len(packed_levels)
        if self._points > MAX_POINTS:
            what = f"the waveforms have too many points, allowed: at most {MAX_POINTS} in all"
            remedy = "send fewer points, or reversals of a larger min_swing or a shorter duration"
            raise WaveformCostError(what, remedy)
        self._count_terms(1)
        times = array("d", times_s).tobytes()
        return {
            "kind": "path",
            "times_s": times,
            "levels": packed_levels.tobytes(),
            "bounds": bounds,
            "stepped": stepped,
        }

    def _count_terms(self, terms: int) -> None:
        self._terms += terms
        if self._terms > MAX_TERMS:
            what = (
                f"the waveforms have too many parts, allowed: at most {MAX_TERMS} in all, each "
                "sinusoid of a multisine counted"
            )
            raise WaveformCostError(what, "sum fewer, or send the sum as points")


def unpack_waveforms(packed: Mapping[str, Packed]) -> dict[str, LoopWaveform]:
    """Return the waveforms that `pack_waveforms` packed. Real-time safe.

    They were validated before, and are not validated again.

    Raises:
        KeyError: If a key is missing or a kind is unknown.
        TypeError: If a value has the wrong type.
        ValueError: If the bytes are no doubles.
    """
    return {axis: _unpack(waveform) for axis, waveform in packed.items()}


def _unpack(packed: Packed) -> Any:
    match packed["kind"]:
        case "path":
            times_s, levels = array("d"), array("d")
            times_s.frombytes(packed["times_s"])
            levels.frombytes(packed["levels"])
            low, high = packed["bounds"]
            return PackedPath(times_s, levels, low, high, packed["stepped"])
        case "sum":
            return Sum.model_construct(kind="sum", parts=tuple(map(_unpack, packed["parts"])))
        case "sequence":
            parts = tuple(map(_unpack_part, packed["parts"]))
            return Sequence.model_construct(kind="sequence", parts=parts)
        case "multisine":
            sines = tuple(Component.model_construct(**one) for one in packed["components"])
            return Multisine.model_construct(**(packed | {"components": sines}))
        case "setpoint":
            return Setpoint.model_construct(**packed)
        case kind:
            fields = packed["envelope"]
            changing = _ENVELOPES.get(fields["kind"])
            envelope = changing.model_construct(**fields) if changing else _CONSTANT
            return _PERIODIC[kind].model_construct(**(packed | {"envelope": envelope}))


def _unpack_part(packed: Packed) -> SequencePart:
    waveform = _unpack(packed["waveform"])
    return SequencePart.model_construct(duration_s=packed["duration_s"], waveform=waveform)


_CONSTANT: Final = ConstantEnvelope()
_ENVELOPES: Final[Mapping[str, type[BaseModel]]] = {
    "modulated": ModulatedEnvelope,
    "decaying": DecayingEnvelope,
}
_PERIODIC: Final[Mapping[str, type[BaseModel]]] = {"sine": Sine, "triangle": Triangle}
