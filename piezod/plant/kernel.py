"""The physics of one sub-step, compiled.

    command ─► converter ─► gain, limits ─► bandwidth, slew ─► + noise ─► drive
    drive ─► Preisach hysteresis ─► + creep + drift ─► first mode ─► displacement
    displacement ─► fibre curve ─► + noise ─► detector ─► anti-alias filter ─► delay ─► converter

**Hysteresis.** The stage is a Preisach model, told by its Everett function: the change of
displacement while the drive u (in nominal drives) rises from a minimum β to α is

    E(α, β) = (r·D + i·D^p) · (1 + κ·(S − 1/2)),   D = α − β,   S = (α + β)/2

and falls by the same amount on the way back from α to β. It is the exact integral of the density
μ(α, β) = −∂²E/∂α∂β = i·p·(p − 1)·D^(p − 2) · (1 + κ·(S − 1/2)), besides a reversible part on the
diagonal, and the density is nowhere negative as long as |κ·(S − 1/2)| ≤ 1. The state is the list of
turning points that no later turn has wiped out, so there is no grid and no error of a grid. The
width of a loop grows with its swing as measured on a real stage, and κ bends its two branches
differently; `tests/plant/test_hysteresis.py` holds the comparison in numbers.
"""

from math import exp
from typing import Any, TypeAlias

from piezod.jit import compiled

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`


@compiled
def everett(upper: float, lower: float, constants: Record) -> float:
    """Give the displacement between two drives, in travels; see the top of this file.

    Args:
        upper: α, in nominal drives, at least `lower`.
        lower: β, in nominal drives.
        constants: Of the plant.
    """
    c = constants[0]
    swing = upper - lower
    value = c.reversible * swing
    if c.irreversible > 0.0:
        value += c.irreversible * swing**c.exponent
    return float(value * (1.0 + c.skew * ((upper + lower) / 2.0 - 0.5)))


@compiled
def hysteresis(unit: float, state: Record, constants: Record) -> float:
    """Move the drive to `unit` on a monotonic path and give the displacement in travels.

    Minima have even places in the list of turning points, maxima odd ones. The first two are the
    ends of the range, are never reached from inside and never removed.

    Args:
        unit: Drive in nominal drives, within `lowest` and `highest`.
        state: Of the plant.
        constants: Of the plant.
    """
    s = state[0]
    at, value = s.turn_at, s.turn_value
    depth = s.depth
    rising = depth % 2 == 1
    if (rising and unit < s.unit) or (not rising and unit > s.unit):
        if depth == len(at):
            depth -= 2
            s.dropped += 1
        at[depth] = s.unit
        value[depth] = s.hysteretic
        depth += 1
        rising = not rising
    if rising:
        while depth > 3 and unit >= at[depth - 2]:
            depth -= 2
        s.hysteretic = value[depth - 1] + everett(unit, at[depth - 1], constants)
    else:
        while depth > 3 and unit <= at[depth - 2]:
            depth -= 2
        s.hysteretic = value[depth - 1] - everett(at[depth - 1], unit, constants)
    s.depth = depth
    s.unit = unit
    return float(s.hysteretic)


@compiled
def target_v(command_v: float, constants: Record) -> float:
    """Give the voltage that the amplifier goes to: converted, amplified, limited.

    Args:
        command_v: Commanded voltage across the actuator, in V.
        constants: Of the plant.
    """
    c = constants[0]
    code_v = min(max(command_v / c.nominal_gain, -c.dac_limit_v), c.dac_limit_v)
    if c.dac_step_v > 0.0:
        code_v = min(round(code_v / c.dac_step_v) * c.dac_step_v, c.dac_limit_v - c.dac_step_v)
    return float(min(max(code_v * c.gain, c.output_min_v), c.output_max_v))


@compiled
def output_v(now_v: float, goal_v: float, constants: Record) -> float:
    """Give the amplifier's output half a sub-step on: a first-order lag with limited slew, exact.

    Args:
        now_v: Output now, in V.
        goal_v: Where it goes, in V.
        constants: Of the plant.
    """
    c = constants[0]
    distance = goal_v - now_v
    if abs(distance) <= c.slew_ends_v:
        return float(goal_v - distance * c.half_decay)
    way_v = c.slew_v_per_s if distance > 0.0 else -c.slew_v_per_s
    slewing_s = (abs(distance) - c.slew_ends_v) / c.slew_v_per_s
    if slewing_s >= c.half_step_s:
        return float(now_v + way_v * c.half_step_s)
    if c.lag_s == 0.0:
        return goal_v
    return float(goal_v - way_v * c.lag_s * exp((slewing_s - c.half_step_s) / c.lag_s))


@compiled
def fibre_v(position_um: float, constants: Record) -> float:
    """Give the light, in V, at a displacement; touching the probe leaves none.

    Args:
        position_um: Displacement from rest, away from the probe, in µm.
        constants: Of the plant.
    """
    c = constants[0]
    gap_um = max(c.rest_gap_um + position_um, 0.0)
    bend = (gap_um / c.peak_gap_um) ** 3 / 2.0
    return float(c.slope_v_per_um * gap_um / (1.0 + bend))


@compiled
def fibre_slope(position_um: float, constants: Record) -> float:
    """Give the slope of `fibre_v` in V/µm."""
    c = constants[0]
    gap_um = c.rest_gap_um + position_um
    if gap_um <= 0.0:
        return 0.0
    bend = (gap_um / c.peak_gap_um) ** 3 / 2.0
    return float(c.slope_v_per_um * (1.0 - 2.0 * bend) / (1.0 + bend) ** 2)


@compiled
def row(matrix: Any, number: int, known: Any) -> float:
    """Give one row of a matrix times a tuple as long as the row."""
    total = 0.0
    for i in range(len(known)):
        total += matrix[number, i] * known[i]
    return total


@compiled
def move(middle_v: float, end_v: float, state: Record, constants: Record) -> None:
    """Move the stage by one sub-step.

    Args:
        middle_v: Drive across the actuator half a sub-step on, in V.
        end_v: Drive at the end of the sub-step, in V.
        state: Of the plant.
        constants: Of the plant.
    """
    s, c = state[0], constants[0]
    at_start = s.hysteretic
    in_middle = hysteresis(min(max(middle_v / c.drive_v, c.lowest), c.highest), state, constants)
    at_end = hysteresis(min(max(end_v / c.drive_v, c.lowest), c.highest), state, constants)
    s.drive_v = end_v

    mean = (at_start + 4.0 * in_middle + at_end) / 6.0
    crept = 0.0
    for i in range(len(s.lags)):
        s.lags[i] += c.creep_gains[i] * (mean - s.lags[i])
        crept += c.creep_weights[i] * s.lags[i]
    s.swing = max(s.unit, s.swing * c.drift_keep)
    s.drifted += c.drift_gain * (c.drift * s.swing - s.drifted)
    slow_before, s.slow = s.slow, crept + s.drifted

    # Follow the static displacement by a parabola, and let the mode ring on top of it, exactly.
    quick = 1.0 - c.creep_at_reference
    start_um = s.static_um
    middle_um = c.travel_um * (quick * in_middle + (slow_before + s.slow) / 2.0)
    end_um = s.static_um = c.travel_um * (quick * at_end + s.slow)
    known = (s.displacement_um, s.slope_um, start_um, middle_um, end_um)
    s.displacement_um = row(c.mode, 0, known)
    s.slope_um = row(c.mode, 1, known)
    s.start_slope_um = row(c.mode, 2, known)


@compiled
def jump(goal_v: float, state: Record, constants: Record) -> None:
    """Let an amplifier that follows at once go to `goal_v` before the sub-step begins."""
    s, c = state[0], constants[0]
    s.output_v = goal_v
    unit = min(max((goal_v + s.noise_v) / c.drive_v, c.lowest), c.highest)
    value = hysteresis(unit, state, constants)
    s.static_um = c.travel_um * ((1.0 - c.creep_at_reference) * value + s.slow)


@compiled
def sense(before_um: float, noise_v: float, state: Record, constants: Record) -> None:
    """Let the sensor watch the sub-step that `move` made.

    Args:
        before_um: Displacement at the start of the sub-step in µm.
        noise_v: Noise of the light during the sub-step in V.
        state: Of the plant.
        constants: Of the plant.
    """
    s, c = state[0], constants[0]
    known = (
        s.detector_v,
        s.filter_v,
        s.filter_slope_v,
        fibre_v(before_um, constants),
        fibre_slope(before_um, constants) * s.start_slope_um,
        fibre_v(s.displacement_um, constants),
        fibre_slope(s.displacement_um, constants) * s.slope_um,
        noise_v,
    )
    s.detector_v = row(c.receiver, 0, known)
    s.filter_v = row(c.receiver, 1, known)
    s.filter_slope_v = row(c.receiver, 2, known)
    s.newest = (s.newest + 1) % len(s.past_v)
    s.past_v[s.newest] = s.filter_v
    s.past_slope_v[s.newest] = s.filter_slope_v


@compiled
def reading_v(ago: float, state: Record, constants: Record) -> float:
    """Give what the converter reports of the filtered light `ago` sub-steps before the newest."""
    s, c = state[0], constants[0]
    size = len(s.past_v)
    whole = int(ago)
    later = (s.newest - whole) % size
    earlier = (later - 1) % size
    t = 1.0 - (ago - whole)  # from `earlier`, 0, to `later`, 1: a cubic with the known slopes
    u = 1.0 - t
    light_v = u * u * (
        (1.0 + 2.0 * t) * s.past_v[earlier] + t * s.past_slope_v[earlier]
    ) + t * t * ((1.0 + 2.0 * u) * s.past_v[later] - u * s.past_slope_v[later])
    if c.adc_step_v > 0.0:
        light_v = round(light_v / c.adc_step_v) * c.adc_step_v
    light_v = min(max(light_v, -c.saturation_v), c.saturation_v)
    return float(light_v)


@compiled
def advance(
    sub_steps: int, command_v: float, ago: float, state: Record, constants: Record
) -> float:
    """Let time pass and give what the sensor's converter reports, in V.

    Args:
        sub_steps: How many, no more than noise has been drawn for.
        command_v: The voltage commanded all this time, in V.
        ago: How many sub-steps before the end the reported light left the filter.
        state: Of the plant.
        constants: Of the plant.
    """
    s, c = state[0], constants[0]
    goal_v = target_v(command_v, constants)
    if c.follows_at_once and sub_steps > 0:  # the step is no part of the parabola that follows
        jump(goal_v, state, constants)
    for _ in range(sub_steps):
        middle_v = output_v(s.output_v, goal_v, constants)
        s.output_v = output_v(middle_v, goal_v, constants)
        noise_before_v = s.noise_v
        s.noise_v = c.noise_decay * noise_before_v + c.noise_kick_v * s.noise[s.taken, 0]
        before_um = s.displacement_um
        move(
            middle_v + (noise_before_v + s.noise_v) / 2.0,
            s.output_v + s.noise_v,
            state,
            constants,
        )
        sense(before_um, c.light_noise_v * s.noise[s.taken, 1], state, constants)
        s.taken += 1
    return reading_v(ago, state, constants)
