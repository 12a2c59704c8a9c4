"""Records of a stage that is a surface with a first mode, which rings at each jump of the drive."""

import numpy as np

from piezod.control.law.first_mode import FirstMode
from piezod.experiment.fit.record import Record
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up import DRIVE_V, POSITION_UM
from tests.experiment.made_up_surface import all_loops, made_up_surface

RATE_HZ, FINER = 2000.0, 20
MODE = FirstMode(frequency_hz=180.0, damping=0.03)


def ringing_record(
    *,
    duration_s: float = 4.0,
    delay_s: float = 0.0011,
    noise: float = 1e-3,
    mode: FirstMode = MODE,
    held_s: float = 0.01,
    two_levels: bool = False,
    seed: int = 1,
) -> Record:
    """Return a record of the made-up stage.

    Args:
        duration_s: Length, in s.
        delay_s: Delay of the displacement behind the held drive, in s.
        noise: Standard deviation of the noise of the sensor, as a share of the range.
        mode: The first mode.
        held_s: Mean time for which a random voltage is held; 0 for a smooth drive with all loops.
        two_levels: Whether only a fifth and four fifths of the voltage are held.
        seed: Seed of the drive and of the noise.
    """
    random, count = np.random.default_rng(seed), round(duration_s * RATE_HZ)
    t_s: FloatArray = np.arange(count, dtype=np.float64) / RATE_HZ
    drives: FloatArray = np.clip(all_loops(40.0 / duration_s * t_s), 0.0, 1.0)
    if held_s:
        jumps = random.random(count) < 1.0 / (held_s * RATE_HZ)
        jumps[0] = False
        drives = np.append(0.0, random.random(np.count_nonzero(jumps)))[np.cumsum(jumps)]
        drives = np.where(drives < 0.5, 0.2, 0.8) if two_levels else drives
    # Finer than the record, so that the discretisation of a fit is no part of it.
    held = np.repeat(SurfaceForm().positions_at(made_up_surface(), drives), FINER)
    fine_s = 1.0 / (RATE_HZ * FINER)
    x = mode.shown(held, delay_s + 0.5 * fine_s, fine_s)[::FINER]
    x = x + noise * random.standard_normal(count)
    return Record(t_s, DRIVE_V * drives, POSITION_UM * x)
