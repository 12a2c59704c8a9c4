"""The records of the comparison: measured ones beside the checkout, and simulated ones."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from benchmarks.peers.method import Series
from benchmarks.peers.simulated import simulated_records
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.smoothing import smoothed_record
from piezod.experiment.fit.source import read_source
from piezod.plant.variants import VARIANTS

ROOT: Final = Path(__file__).parents[2]
SHARED: Final = Path(os.environ.get("PIEZOD_SHARED_DATA", ROOT.parent / "shared"))
"""Folder with recorded data, as for the tests."""
RUN_IN_S: Final = 1.0
"""First part of a measured record that does not count."""
ONE_SAMPLE_S: Final = 0.005


class Absent(Exception):  # noqa: N818 - it is the reason for a skipped record, not an error
    """A record cannot be had here; the text is the reason."""


class Case(NamedTuple):
    """A record of the comparison."""

    about: str  #: The record, for people.
    record: Record  #: Record of the fit.
    test: Record  #: Record of the test.
    delay_s: float  #: Delay that all methods get, in s.
    without_offset: bool  #: Whether a constant is removed from the errors of the test.

    def series(self) -> tuple[Series, Series]:
        """Return the record and the test as every method gets them.

        The delay is taken out, the displacement is smoothed as piezod does it, and the ranges of
        the record become [0, 1].
        """
        drive_v, position_um = (
            (float(values.min()), float(values.max()))
            for values in (
                self.record.drive_v[self.record.counted()],
                smoothed_record(self.record).position_um[self.record.counted()],
            )
        )

        def series_of(record: Record) -> Series:
            smooth = smoothed_record(record)
            return Series(
                positions=(smooth.position_um - position_um[0]) / np.ptp(position_um),
                drives=(record.drive_delayed_by(self.delay_s) - drive_v[0]) / np.ptp(drive_v),
                counted=record.counted(self.delay_s),
            )

        return series_of(self.record), series_of(self.test)


def measured() -> Case:
    """Return the measured record of a stack in a flexure, at 1 Hz.

    Raises:
        Absent: If the folder is not there.
    """
    folder = SHARED / "data" / "ntu_p885"
    if not folder.is_dir():
        raise Absent(f"{folder} is not a folder (set PIEZOD_SHARED_DATA)")
    return Case(
        about="measured: stack P-885.91 in a flexure, 1 Hz; the test is another record, from whose "
        "errors a constant offset is removed, because the zero drifts from day to day",
        record=read_source(folder / "identification.csv", RUN_IN_S).record,
        test=read_source(folder / "test.csv", RUN_IN_S).record,
        delay_s=ONE_SAMPLE_S,  # one frequency does not determine it
        without_offset=True,
    )


def simulated(variant: str) -> Case:
    """Return records of the simulated rig, by the name of its variant."""
    record, test = simulated_records(variant)
    fit = fit_model(record, FitSettings(method=Method.SURFACE, creep=True))
    return Case(
        about=f"simulated: {VARIANTS[variant].summary}; the test is another drive, sines without a "
        "common period and random reversals",
        record=record,
        test=test,
        delay_s=max(fit.model.delay_s, 0.0),  # the fits of stops know no negative one
        without_offset=False,
    )


CASES: Final[Mapping[str, Callable[[], Case]]] = {
    "ntu_p885": measured,
    **{variant: partial(simulated, variant) for variant in VARIANTS},
}
"""Every record, by name."""
