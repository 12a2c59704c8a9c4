"""Refuses records that cannot give a model."""

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.errors import DataError
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange


def check_record(record: Record, order: int, delay_s: float) -> None:
    """Refuse a record that is too short, constant, or does not grow with the drive.

    Args:
        record: Drive and displacement.
        order: Operators on each side.
        delay_s: Delay of the displacement behind the drive, in s; 0 if it is not known yet.

    Raises:
        DataError: If the record cannot give a model.
    """
    n_weights = 2 * order
    counted, fewest = record.counted(delay_s), SAMPLES_PER_WEIGHT * n_weights
    drive_v = record.drive_delayed_by(delay_s)[counted]
    position_um = record.position_um[counted]
    if drive_v.size < fewest:
        raise DataError(
            f"{drive_v.size} samples are left for {n_weights} weights; allowed are {fewest} or "
            "more; record for longer, skip less, or fit fewer operators"
        )
    scaled = []
    for name, values in (("drive_v", drive_v), ("position_um", position_um)):
        low, high = float(values.min()), float(values.max())
        if low == high:
            raise DataError(f"{name} is {low:g} throughout; allowed is a signal that varies")
        scaled.append(AffineRange.checked(low, high).to_unit(values))
    correlation = float(np.corrcoef(scaled[0], scaled[1])[0, 1])
    if correlation <= 0.0:
        raise DataError(
            "position_um does not grow with the drive: its correlation with drive_v is "
            f"{correlation:.2f}; allowed is above 0; change the sign of one of them if the "
            "sensor counts in the other direction, else check that it is the sensor of this drive"
        )
