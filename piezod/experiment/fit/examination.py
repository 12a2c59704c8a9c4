"""What of a record cannot be true, before anything is fitted to it.

A displacement lags behind its drive: over the drive its loops run counterclockwise. They run
clockwise if the columns are exchanged, or if the drive was recorded later than the displacement.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from piezod.errors import DataError
from piezod.experiment.fit.excitation import turning_points
from piezod.experiment.fit.record import Record, check_varies
from piezod.experiment.fit.recorded import MAX_FILLED, MAX_FILLED_S, MAX_MISSING_SHARE
from piezod.experiment.fit.run_in import mark_unknown_past
from piezod.experiment.fit.samples import Bad, Kind, bad_samples
from piezod.hysteresis.memory import FloatArray

LEAST_SENSE: Final = -0.01
"""Area of the loops, as a share of the squares around their swings; smaller ones run the wrong way
round."""
FOLLOWS: Final = 0.3
"""Correlation of drive and displacement from which on one follows the other."""
LEAST_PART: Final = 0.5
"""Smallest part of a record that may be used alone, without what is not true in the rest."""
LONG_STEP_S, LONG_RECORD_S = 0.1, 3600.0
"""A time step from which on the time is probably in ms; in records of over an hour, surely."""
HIGH_V, LOW_V = 1500.0, 12.0
"""A voltage above which the drive is probably in mV, and a range below which it is probably that of
an input or a monitor; amplifiers for stacks have 100 to 1000 V."""
LONG_UM, SHORT_UM = 3000.0, 0.1
"""Ranges above which the displacement is probably in nm, and below which it is probably in mm."""
_MOST_TOLD: Final = 5


class Examined(NamedTuple):
    """A record without what is not true in it."""

    record: Record
    notes: tuple[str, ...]  #: What was left out, a sentence each.
    questions: tuple[str, ...]  #: What only the user knows, a question each.


def examined(record: Record, delay_s: float = 0.0) -> Examined:
    """Return a record without samples that are not true, and what to ask about it.

    Args:
        record: Drive and displacement, as recorded.
        delay_s: Delay of the displacement behind the drive, if it is known, in s.

    Raises:
        DataError: If no model can be fitted to it; the text says what is not true, and asks for
            the probable cause.
    """
    check_varies(record.drive_v, record.position_um)
    _check_time(record)
    _check_direction(record, delay_s)
    mended, notes = _mended(record, bad_samples(record))
    asked = (*_question_of_sense(mended, delay_s), *_questions(mended))
    return Examined(mended, notes, asked)


def sense(drive: FloatArray, position: FloatArray) -> float:
    """Return the area of the loops of a displacement over its drive, as a share of their squares.

    Args:
        drive: (n,) drive.
        position: (n,) displacement; positive if it lags behind the drive.
    """
    v = (drive - drive[0]) / np.ptp(drive)
    x = (position - position[0]) / np.ptp(position)
    # The line from the end to the start closes the path and adds nothing, because it starts at 0.
    area = 0.5 * float(np.sum(v[:-1] * x[1:] - v[1:] * x[:-1]))
    swings = np.diff(v[turning_points(v)])
    return area / max(0.5 * float(np.sum(swings**2)), 1e-12)


def _check_time(record: Record) -> None:
    length_s = float(record.t_s[-1] - record.t_s[0])
    if record.period_s >= LONG_STEP_S and length_s > LONG_RECORD_S:
        raise DataError(
            f"t_s advances by {record.period_s:.4g} s from sample to sample, over "
            f"{length_s / 3600.0:.3g} hours: is it in ms? Then --scale t=0.001; allowed are "
            f"records of up to {LONG_RECORD_S / 3600.0:g} hour, or with steps below "
            f"{LONG_STEP_S:g} s"
        )


def _check_direction(record: Record, delay_s: float) -> None:
    counted = record.counted(delay_s)
    drive_v = record.drive_delayed_by(delay_s)[counted]
    correlation = float(np.corrcoef(drive_v, record.position_um[counted])[0, 1])
    if correlation > 0.0:
        return
    found = (
        "position_um does not grow with the drive: its correlation with drive_v is "
        f"{correlation:.2f}; allowed is above 0"
    )
    if correlation < -FOLLOWS:
        raise DataError(
            f"{found}; does the sensor count in the other direction? Then --invert position"
        )
    raise DataError(
        f"{found}; it does not follow the drive at all: check that it is the sensor of this drive, "
        "and that both are connected"
    )


def _sense_after(record: Record, delay_s: float) -> float:
    """Return the sense of the loops if the displacement is late by a delay, in s."""
    counted = record.counted(delay_s)
    return sense(record.drive_delayed_by(delay_s)[counted], record.position_um[counted])


def _question_of_sense(record: Record, delay_s: float) -> Iterator[str]:
    """Yield a question if the loops run the wrong way round by less than a sample explains.

    Raises:
        DataError: If no sample explains it.
    """
    found = _sense_after(record, delay_s)
    if found >= LEAST_SENSE:
        return
    # A voltage that was held until its sample acted half a period earlier, on average.
    if _sense_after(record, delay_s - 0.5 * record.period_s) < LEAST_SENSE:
        raise DataError(
            f"the loops run the wrong way round: their area is {100.0 * found:.2g} % of the "
            f"squares around their swings, allowed is {100.0 * LEAST_SENSE:g} % or more, "
            "because a stage follows its drive; are drive_v and position_um exchanged? Then "
            "--columns drive=position_um,position=drive_v. Or was the drive recorded later than "
            "the position, by a filter or an echo? Then record both at the same time, or give the "
            "negative delay with --method surface --delay-s"
        )
    yield (
        "The loops run the wrong way round, by less than half a sample explains: are drive_v and "
        "position_um exchanged? Then --columns drive=position_um,position=drive_v. Else record at "
        "a higher rate."
    )


# ------------------------------------------------------------------- samples that are not true


def _mended(record: Record, bad: Sequence[Bad]) -> tuple[Record, tuple[str, ...]]:
    """Return a record in which few bad samples are straight lines, or its longest good part."""
    _check_sensor(record, bad)
    most = max(MAX_FILLED, round(MAX_FILLED_S / record.period_s))
    filled = [each for each in bad if each.kind is not Kind.JUMP and _count(each) <= most]
    cuts = [each for each in bad if each not in filled]
    position_um, notes = record.position_um, []
    if filled:
        good = np.ones(record.t_s.size, np.bool_)
        for each in filled:
            good[each.first : each.last + 1] = False
        position_um = np.interp(record.t_s, record.t_s[good], position_um[good])
        notes.append(f"{_told(filled, record)}. They were replaced by straight lines.")
    mended = replace(record, position_um=position_um)
    if not cuts:
        return mended, tuple(notes)
    part, note = _longest_part(mended, cuts)
    return part, (*notes, note)


def _count(bad: Bad) -> int:
    return bad.last - bad.first + 1


def _check_sensor(record: Record, bad: Sequence[Bad]) -> None:
    """Refuse a sensor that was at the end of its range, and too many outliers."""
    for each in bad:
        if each.kind is Kind.CLIPPED:
            end_um = float(record.position_um[each.first])
            end = "highest" if end_um == float(record.position_um.max()) else "lowest"
            moved = each.size / float(np.ptp(record.drive_v))
            raise DataError(
                f"the displacement stands at its {end} value, {end_um:.6g} µm, for "
                f"{_count(each)} samples from {_place(each, record)}, while the drive moves over "
                f"{100.0 * moved:.2g} % of its range: the sensor is clipped at the end of its "
                "range; use a smaller drive, or move the sensor's range"
            )
    outliers = [each for each in bad if each.kind is Kind.OUTLIER]
    share = sum(map(_count, outliers)) / record.t_s.size
    if share > MAX_MISSING_SHARE:
        raise DataError(
            f"{_told(outliers, record)}: {100.0 * share:.2g} % of the samples, "
            f"allowed are {100.0 * MAX_MISSING_SHARE:g} %; mend the sensor or its cable, "
            "and record again"
        )


def _longest_part(record: Record, cuts: Sequence[Bad]) -> tuple[Record, str]:
    """Return the longest part of a record between cuts, and what was left out.

    Raises:
        DataError: If it is too short.
    """
    begins = [0, *(each.first if each.kind is Kind.JUMP else each.last + 1 for each in cuts)]
    ends = [*(each.first for each in cuts), record.t_s.size]
    begin, end = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    share = (end - begin) / record.t_s.size
    found = _told(cuts, record)
    if share < LEAST_PART:
        raise DataError(
            f"{found}: the longest part without one is {100.0 * share:.2g} % of the record, "
            f"allowed are {100.0 * LEAST_PART:g} %; mend the sensor, or cut the record there"
        )
    t_s = record.t_s
    part = replace(
        record,
        t_s=t_s[begin:end],
        drive_v=record.drive_v[begin:end],
        position_um=record.position_um[begin:end],
        run_in_s=max(record.run_in_s - float(t_s[begin] - t_s[0]), 0.0),
    )
    used = f"{found}. The longest part without one is used, from {t_s[begin]:.5g} to "
    return mark_unknown_past(part).after(part.run_in_s), f"{used}{t_s[end - 1]:.5g} s."


_NAMES: Final = {
    Kind.OUTLIER: "outlier of position_um, by up to {:.3g} µm",
    Kind.JUMP: "jump of position_um without the drive, by up to {:.3g} µm, as of an interferometer "
    "that loses a fringe",
    Kind.STUCK: "stuck value of position_um, while the drive moves by up to {:.3g} V",
}


def _told(bad: Sequence[Bad], record: Record) -> str:
    """Return what was found, and where."""
    kinds = []
    for kind, name in _NAMES.items():
        ours = [each for each in bad if each.kind is kind]
        if not ours:
            continue
        places = ", ".join(_place(each, record) for each in ours[:_MOST_TOLD])
        more = f" and {len(ours) - _MOST_TOLD} more" if len(ours) > _MOST_TOLD else ""
        largest = max(abs(each.size) for each in ours)
        kinds.append(f"{len(ours)} × {name.format(largest)}: {places}{more}")
    return "; ".join(kinds)


def _place(bad: Bad, record: Record) -> str:
    """Return time and number of a sample; the first one has the number 1."""
    return f"t = {record.t_s[bad.first]:.6g} s (sample {bad.first + 1})"


# ------------------------------------------------------------------- units


def _questions(record: Record) -> Iterator[str]:
    """Yield a question for each column that is probably in another unit than its name says."""
    length_s = float(record.t_s[-1] - record.t_s[0])
    if record.period_s >= LONG_STEP_S:
        yield (
            f"t_s advances by {record.period_s:.3g} s from sample to sample, {length_s:.4g} s in "
            "all: is it in ms? Then --scale t=0.001."
        )
    highest_v, range_v = float(np.max(np.abs(record.drive_v))), float(np.ptp(record.drive_v))
    if highest_v > HIGH_V:
        yield f"drive_v reaches {highest_v:.5g} V: is it in mV? Then --scale drive=0.001."
    elif range_v < LOW_V:
        yield (
            f"drive_v has a range of {range_v:.3g} V: is it in kV, or the input or the monitor of "
            "an amplifier? Then --scale drive=GAIN; the model needs the voltage that piezod "
            "will set."
        )
    range_um = float(np.ptp(record.position_um))
    if range_um > LONG_UM:
        yield (
            f"position_um has a range of {range_um:.5g} µm: is it in nm? Then --scale "
            "position=0.001."
        )
    if range_um < SHORT_UM:
        yield (
            f"position_um has a range of {range_um:.3g} µm: is it in mm, or in V of a monitor? "
            "Then --scale position=1000, or the µm per V."
        )
