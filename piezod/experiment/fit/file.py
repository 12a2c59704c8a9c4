"""From a recorded file to a model: read, fit, judge on this file and on another one."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.plausible import Span
from piezod.errors import DataError
from piezod.experiment.fit.automatic import Choice, Wanted, choose
from piezod.experiment.fit.errors import Breakdown, Judgement, breakdown_of, judge
from piezod.experiment.fit.examination import examined
from piezod.experiment.fit.excitation import missing_excitation
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.slew import slew_warnings
from piezod.experiment.fit.smoothing import smoothed_record
from piezod.experiment.fit.source import NO_CHOICES, Source, read_source
from piezod.experiment.fit.thinning import MAX_SAMPLES, thinned
from piezod.experiment.fit.uncertainty import Uncertainty, uncertainty_of
from piezod.experiment.fit.warnings import (
    fit_warnings,
    mode_warnings,
    quality_warnings,
    residual_warnings,
)
from piezod.experiment.prefix import prefix_errors
from piezod.experiment.progress import Progress
from piezod.hysteresis import AffineRange
from piezod.reading.choices import Choices
from piezod.records.recording.reader import is_recording

START_S = 2.0
"""Part of a record in which a start away from rest shows most, in s."""
WORSE_AT_START = 3.0
"""The worst error of the start is suspicious if it exceeds the later ones by this factor."""
SUSPICIOUS_PCT = 1.0
"""It must also exceed this, in % of the voltage's range."""
_BEYOND = 0.01  # share of the range; noise and creep may exceed the range by it


@dataclass(frozen=True)
class FileFit:
    """A model fitted to a file, and its quality."""

    data: Path  #: The file.
    test_data: Path | None  #: Another file on which the model was judged, None without one.
    recorded: Record  #: The record in the file.
    record: Record  #: The record of the fit: a long record is averaged.
    chosen: Judgement  #: The model, its fit, and its errors.
    #: The same fit with creep if `chosen` has none, and without if it has; None for LMS, which has
    #: no creep, and if no creep could be fitted.
    other: Judgement | None
    #: The same fit as `chosen` to the unsmoothed displacement, and judged on it; None for LMS,
    #: which never smooths.
    raw: Judgement | None
    uncertainty: Uncertainty  #: Uncertainty of the model.
    parts: Breakdown  #: Parts of the residual of the position in the record.
    choice: Choice | None  #: Candidates among which the model was chosen, None if it was given.
    missing_excitation: tuple[str, ...]  #: Excitation that the record lacks, a sentence each.
    warnings: tuple[str, ...]  #: Warnings for the user of the model, a sentence each.
    questions: tuple[str, ...] = ()  #: What only the user knows about the record, a question each.
    #: Why the model is not that of the axis, a clause each; empty also if the axis is unknown.
    misfits: tuple[str, ...] = ()
    #: First mode in the configuration of the axis; None if there is none, or if it is unknown.
    configured_mode: FirstModeConfig | None = None
    understood: tuple[str, ...] = ()  #: What was inferred about the file, a sentence each.

    def of_axis(self, config: AxisConfig) -> "FileFit":
        """Return the fit beside the configuration of its axis, with what does not fit.

        Such a record has the units of the configuration, so that no question about them remains.
        """
        model, half = self.chosen.fit.model, self.uncertainty.mode
        configured = config.first_mode
        warnings = mode_warnings(model.mode, half, configured) if model.mode and half else ()
        return replace(
            self,
            configured_mode=configured,
            warnings=(*self.warnings, *warnings),
            questions=(),
            misfits=tuple(config.misfits(Span(*model.drive_v, model.position_um.width))),
        )


def identify_file(  # noqa: PLR0913 - each is an option of `piezod identify`
    data: Path,
    *,
    test: Path | None,
    skip_s: float,
    delay_s: float | None,
    axis: str | None = None,
    settings: FitSettings | Wanted,
    choices: Choices = NO_CHOICES,
    progress: Progress = lambda _label, _share: None,
) -> FileFit:
    """Fit a model to a recorded file.

    Args:
        data: Table of time, drive and position in any known format, or recording of a stage.
        test: Another such file, on which the model is judged, too.
        skip_s: First seconds of each file that do not count.
        delay_s: Delay in s; estimated from the data if None.
        axis: Axis of a recording; None for the only one.
        settings: Settings of the fit, or the fixed part of an automatic choice.
        choices: What the person says about the columns of the files.
        progress: Called while models are chosen.

    Raises:
        DataError: If a file cannot be used; the text starts with its name.
        OSError: If a file cannot be read.
    """
    given = _read(data, test, skip_s, axis, delay_s, choices)
    record, test_record, delay_s = given.record, given.test_record, given.source.delay_s
    with prefix_errors(str(data)):
        choice = None
        if isinstance(settings, Wanted):
            choice = choose(record, settings, delay_s, progress)
            fit = choice.chosen.fit
        else:
            fit = fit_model(record, replace(settings, delay_s=delay_s))
    other, raw = _counterparts(fit, record)
    chosen = judge(fit, record, test_record, choice.chosen.validation if choice else None)
    parts = breakdown_of(fit, given.source.record)
    found = [*_warnings(fit, record, test_record, by_blocks=choice is not None)]
    with prefix_errors(str(data)):
        found += quality_warnings(chosen, record, test_record)
    found += residual_warnings(chosen, parts)
    return FileFit(
        data=data,
        test_data=test,
        recorded=given.source.record,
        record=record,
        chosen=chosen,
        other=judge(other, record, test_record) if other else None,
        raw=judge(raw, record, test_record) if raw else None,
        uncertainty=uncertainty_of(fit, chosen.validation),
        parts=parts,
        choice=choice,
        missing_excitation=missing_excitation(smoothed_record(record)),
        warnings=(*given.notes, *found),
        understood=given.source.understood,
        questions=given.questions,
    )


class _Given(NamedTuple):
    """The files of an identification."""

    source: Source  #: The file of the fit.
    record: Record  #: Its record: a long one is averaged.
    test_record: Record | None  #: That of the test, None without one.
    notes: tuple[str, ...]  #: What to know about the files, a sentence each.
    questions: tuple[str, ...]  #: What only the user knows about them, a question each.


def _read(
    data: Path,
    test: Path | None,
    skip_s: float,
    axis: str | None,
    delay_s: float | None,
    choices: Choices,
) -> _Given:
    source, questions = _examined(data, skip_s, axis, delay_s, choices)
    record, notes = thinned(source.record), tuple(_notes("record", source))
    if not test:
        return _Given(source, record, None, notes, questions)
    test_source, others = _examined(test, skip_s, axis, source.delay_s, choices)
    # Nobody knows what the stage did before the test.
    test_record = replace(thinned(test_source.record), from_rest=False)
    return _Given(
        source,
        record,
        test_record,
        (*notes, *_notes("test", test_source)),
        (*questions, *(f"Test: {each}" for each in others)),
    )


def _examined(
    path: Path, skip_s: float, axis: str | None, delay_s: float | None, choices: Choices
) -> tuple[Source, tuple[str, ...]]:
    """Return a file without what is not true in it, with the delay to use, and what to ask."""
    source = read_source(path, skip_s, axis, choices)
    known_s = source.delay_s if delay_s is None else delay_s
    with prefix_errors(str(path)):
        found = examined(source.record, known_s or 0.0)
    notes = (*source.notes, *found.notes)
    # A recording has the units of the stage that made it.
    told = source._replace(record=found.record, notes=notes, delay_s=known_s)
    return told, () if is_recording(path) else found.questions


def _counterparts(fit: Fit, record: Record) -> tuple[Fit | None, Fit | None]:
    """Return the fit with creep or without, and unsmoothed: what each of them contributes."""
    if not fit.linearised:
        return None, None
    return (
        _refitted(fit, record, replace(fit.settings, creep=not fit.settings.creep)),
        _refitted(fit, record, replace(fit.settings, smoothing=False)),
    )


def _refitted(fit: Fit, record: Record, settings: FitSettings) -> Fit | None:
    """Return the same fit with other settings; None if the record does not support them."""
    if settings == fit.settings:
        return fit
    try:
        again = fit_model(record, replace(settings, delay_s=fit.model.delay_s))
    except DataError:
        return None
    return replace(again, delay=fit.delay)


def _warnings(fit: Fit, record: Record, test: Record | None, *, by_blocks: bool) -> Iterator[str]:
    yield from fit_warnings(fit, record.period_s, by_blocks=by_blocks)
    yield from slew_warnings(fit.as_fitted(record))
    yield from _start_warnings(fit)
    if test is not None:
        yield from _range_warnings(fit.model.position_um, test)


def _notes(name: str, source: Source) -> Iterator[str]:
    """Yield what to know about a file, and the part of it that is not used."""
    yield from source.notes if name == "record" else (f"Test: {each}" for each in source.notes)
    recorded, used = source.record, thinned(source.record)
    left_out_s = float(recorded.t_s[-1] - used.t_s[-1])
    if left_out_s > 2.0 * used.period_s:  # averaging may drop a part of an average
        yield (
            f"The last {left_out_s:.4g} s of the {name} are not used: it has {recorded.t_s.size} "
            f"samples, its drive is too fast for averaging, and at most {MAX_SAMPLES} are used. "
            "Record at a lower rate, or for a shorter time."
        )


def _start_warnings(fit: Fit) -> Iterator[str]:
    record = fit.record
    t_s = record.t_s[record.counted(fit.model.delay_s)]
    residuals_pct = np.abs(fit.residuals_pct(record))
    at_start = t_s - record.t_s[0] < START_S
    if at_start.all() or not at_start.any():
        return
    worst = int(residuals_pct.argmax())
    usual_pct = max(WORSE_AT_START * float(residuals_pct[~at_start].max()), SUSPICIOUS_PCT)
    if at_start[worst] and residuals_pct[worst] > usual_pct:
        yield (
            f"The worst error is at t = {t_s[worst]:.4g} s. The record seems not to start "
            "from rest; leave out the first loops with --skip-s."
        )


def _range_warnings(position_um: AffineRange, test: Record) -> Iterator[str]:
    x = position_um.to_unit(test.position_um[test.counted()])
    share = float(np.mean((x < -_BEYOND) | (x > 1.0 + _BEYOND)))
    if share:
        yield (
            f"{100.0 * share:.2g} % of the test's displacements are outside the range of the "
            f"model, {position_um.low:.6g} to {position_um.high:.6g} µm, and count as its ends."
        )
