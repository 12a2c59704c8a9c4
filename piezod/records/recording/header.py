"""Header of the recording of a running stage."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from piezod.errors import DataError


@dataclass(frozen=True)
class TelemetryHeader:
    """Header of a recording."""

    title: str  #: Description, for people.
    axes: tuple[str, ...]  #: Names of the axes, in the order of the records.
    rate_hz: float  #: Cycles per second, above 0.
    started_at: str  #: Time of day of `start_ns`, ISO 8601 with the offset from UTC.
    start_ns: int  #: Instant of 0 s in the file, on the clock of the records.
    #: Names of the numbers of a field, as in `{"state": ("BOOT", "SAFE")}`.
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)
    #: Texts of the recording by name, as in `{"configuration": "rate_hz: 1000"}`.
    notes: Mapping[str, str] = field(default_factory=dict)
    #: Number of recorded weights of each axis, 2M, or 24 of a surface; an axis without an entry has
    #: none.
    weights: Mapping[str, int] = field(default_factory=dict)
    #: Names of the axes whose weights are, at the start, the coefficients of a surface.
    surfaces: tuple[str, ...] = ()
    #: Meaning of each field, for people, as in `{"late_ns": "Wake-up after …"}`.
    descriptions: Mapping[str, str] = field(default_factory=dict)
    #: Names of the bits of a field, from the lowest, as in `{"present_lo": ("S1", "S2")}`.
    bits: Mapping[str, Sequence[str]] = field(default_factory=dict)
    #: Unit of the positions of user axes in another unit than µm, as in `{"rx": "urad"}`.
    units: Mapping[str, str] = field(default_factory=dict)
    #: Number of the file, if the recording has several; all of them have one `start_ns`.
    part: int = 1

    def configuration(self) -> dict[str, Any] | None:
        """Return the configuration of the stage; None if it is not in the file.

        Raises:
            DataError: If it is no mapping, or its devices or axes are none.
        """
        if "configuration" not in self.notes:
            return None
        try:
            document = json.loads(self.notes["configuration"])
            parts = [document.get(name, {}) for name in ("devices", "axes")]
            whole = all(isinstance(each, dict) for part in parts for each in (part, *part.values()))
        except (ValueError, AttributeError, RecursionError):
            whole = False
        if not whole:
            raise DataError(
                "it is damaged, or another program wrote it: its configuration is not that of a "
                "stage, with devices and axes; take another copy of it, or record again"
            )
        found: dict[str, Any] = document
        return found
