"""One step of the compensator, compiled."""

from piezod.hysteresis.bank import advance_plays, evaluate_plays, weighted_sum
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.memory import SEEN, FloatArray, IntArray, Memory, clamp, locate
from piezod.jit import compiled

POSITION, COMMAND, BEYOND, OUTSIDE = 0, 1, 2, 3
"""What waits for the next step: the displacement that the memory will advance to if the drive was
applied, NaN for none; the command, to be held where the next one is not a number; and how far the
wished drive lay beyond the window, the wished displacement outside of [0, 1], negative below."""

_MOST_STEPS = 50  # of the search for a displacement; about ten are needed
_SAME_DRIVE = 1e-13  # a voltage that differs by rounding only is no move


@compiled
def _model(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, position: float
) -> float:
    """Return the model's drive for a displacement; the memory stays as it is."""
    evaluate_plays(memory, bank, locate(memory, position), position, plays)
    return weighted_sum(plays, bank, weights, position)


@compiled
def _position(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, drive: float
) -> float:
    """Return the displacement for which the model gives a drive, by the Illinois method.

    The model is monotone, 0 at 0 and 1 at 1. Where one end of the bracket stays twice in a row, its
    miss is halved, so that both ends close in.
    """
    drive = clamp(drive, 0.0)
    low, high = 0.0, 1.0
    low_miss, high_miss = -drive, 1.0 - drive
    middle: float = memory.last[SEEN]
    stayed = 0
    miss = weighted_sum(memory.now, bank, weights, middle) - drive
    for _ in range(_MOST_STEPS):
        if abs(miss) < _SAME_DRIVE:
            break
        if miss < 0.0:
            low, low_miss = middle, miss
            high_miss *= 0.5 if stayed > 0 else 1.0
            stayed = 1
        else:
            high, high_miss = middle, miss
            low_miss *= 0.5 if stayed < 0 else 1.0
            stayed = -1
        middle = high - high_miss * (high - low) / (high_miss - low_miss)
        miss = _model(memory, bank, plays, weights, middle) - drive
    return middle


@compiled
def step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    plays: FloatArray,
    pending: FloatArray,
    weights: FloatArray,
    lags: FloatArray,
    creep_gains: FloatArray,
    creep_weights: FloatArray,
    target: FloatArray,
    share: float,
    strength: float,
    command: float,
    stretch: float,
    added: float,
    low: float,
    high: float,
) -> float:
    """Return the drive for a command; may be called in the loop.

    The memory and the lags advance to what the last drive has brought the stage to.

    Args:
        levels: Of the memory, as what follows.
        values: Of the memory.
        now: Of the memory.
        last: Of the memory.
        counts: Of the memory.
        bank: (2, 2 M) of the stops.
        plays: (2 M,) room for plays.
        pending: (4,) what waits from one step to the next.
        weights: (2 M,) in use.
        lags: (K,) of the creep.
        creep_gains: (K,) of the creep.
        creep_weights: (K,) of the creep.
        target: (2 M,) weights that those in use go towards.
        share: Part of the way there that they go in this step.
        strength: From 0, the drive is in proportion to the command, to 1, compensated.
        command: Displacement asked for.
        stretch: What to multiply it by before it is compensated.
        added: Displacement to add then.
        low: Lowest drive.
        high: Highest drive.
    """
    memory = Memory(levels, values, now, last, counts)
    if pending[POSITION] == pending[POSITION]:
        advance_plays(memory, bank, 0.0, pending[POSITION])
    crept = advance_creep(lags, creep_gains, creep_weights, memory.last[SEEN])
    for j in range(weights.size):
        weights[j] += share * (target[j] - weights[j])
    command = clamp(command, pending[COMMAND])
    asked = stretch * command + added - crept
    position = clamp(asked, command)
    pending[OUTSIDE] = asked - position
    model = _model(memory, bank, plays, weights, position)
    wished = model + (1.0 - strength) * (command - model)
    drive = min(max(wished, low), high)
    if drive != model:  # at full strength and within the window it is, to the bit
        position = _position(memory, bank, plays, weights, drive)
    pending[POSITION] = position
    pending[COMMAND] = command
    pending[BEYOND] = wished - drive
    return drive
