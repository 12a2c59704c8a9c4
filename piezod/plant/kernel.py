"""The physics of one sub-step, compiled.

    command ─► converter ─► gain, limits ─► bandwidth, slew ─► + noise ─► drive
    drive ─► hysteresis, gain ─► + creep + drift ─► first mode ─► displacement
    displacement ─► fibre curve ─► + noise ─► detector ─► anti-alias filter ─► delay ─► converter

The class of the hysteresis is a constant of the plant: `preisach.py`, `relays.py`, `path.py`,
`foreign.py`.
"""

from math import exp, sin
from typing import Any, TypeAlias

from piezod.jit import compiled
from piezod.plant.foreign import COLEMAN_HODGDON, add_to_rate, advance_rate, foreign_part
from piezod.plant.path import BOUC_WEN, DAHL, path_part
from piezod.plant.preisach import preisach
from piezod.plant.relays import RELAYS, relax

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`


@compiled
def hysteresis(middle: float, end: float, state: Record, constants: Record) -> float:
    """Move the drive during one sub-step, for any class of hysteresis.

    Args:
        middle: Drive in the middle of the sub-step, in nominal drives, from `lowest` to `highest`.
        end: Drive at the end.
        state: State of the plant; `hysteretic` is the displacement at the end.
        constants: Constants of the plant.

    Returns:
        Displacement in the middle, in travels.
    """
    s, c = state[0], constants[0]
    if c.law in (BOUC_WEN, DAHL):
        in_middle = path_part(middle, state, constants)
        path_part(end, state, constants)
    elif c.law >= COLEMAN_HODGDON:
        advance_rate(end, c.step_s, state)
        in_middle = foreign_part(middle, c.half_step_s, state, constants)
        foreign_part(end, c.half_step_s, state, constants)
    elif c.law == RELAYS:
        before = s.part
        after = relax(middle, state, constants)
        in_middle = c.reversible * middle + c.irreversible * (before + after) / 2.0
        s.hysteretic = c.reversible * end + c.irreversible * after
        s.unit = end
    else:
        in_middle = preisach(middle, state, constants)
        preisach(end, state, constants)
    return float(in_middle)


@compiled
def jump(unit: float, state: Record, constants: Record) -> float:
    """Move the drive at once and return the displacement, in travels; relays need time."""
    s, c = state[0], constants[0]
    if c.law == RELAYS:
        s.hysteretic = c.reversible * unit + c.irreversible * s.part
        s.unit = unit
        return float(s.hysteretic)
    if c.law >= COLEMAN_HODGDON:
        add_to_rate(unit, c.step_s, state)
        return foreign_part(unit, 0.0, state, constants)
    return hysteresis(unit, unit, state, constants)


@compiled
def target_v(command_v: float, constants: Record) -> float:
    """Return the voltage that the amplifier approaches: converted, amplified and limited, in V.

    Args:
        command_v: Commanded voltage across the actuator, in V.
        constants: Constants of the plant.
    """
    c = constants[0]
    code_v = min(max(command_v / c.nominal_gain, -c.dac_limit_v), c.dac_limit_v)
    if c.dac_step_v > 0.0:  # the highest code is one step below the upper end of the range
        code_v = min(round(code_v / c.dac_step_v) * c.dac_step_v, c.dac_limit_v - c.dac_step_v)
    return float(min(max(code_v * c.gain, c.output_min_v), c.output_max_v))


@compiled
def output_v(now_v: float, goal_v: float, constants: Record) -> float:
    """Return the output of the amplifier half a sub-step later, in V.

    The output is a first-order lag with a limited slew rate, solved exactly.

    Args:
        now_v: Output now, in V.
        goal_v: Voltage that the output approaches, in V.
        constants: Constants of the plant.
    """
    c = constants[0]
    distance = goal_v - now_v
    if abs(distance) <= c.slew_ends_v:
        return float(goal_v - distance * c.half_decay)
    # Far from the goal the output slews at constant rate; the lag takes over at `slew_ends_v`,
    # where the speed of the lag equals the slew rate.
    way_v = c.slew_v_per_s if distance > 0.0 else -c.slew_v_per_s
    slewing_s = (abs(distance) - c.slew_ends_v) / c.slew_v_per_s
    if slewing_s >= c.half_step_s:
        return float(now_v + way_v * c.half_step_s)
    if c.lag_s == 0.0:  # without a lag the output arrives while it slews
        return goal_v
    return float(goal_v - way_v * c.lag_s * exp((slewing_s - c.half_step_s) / c.lag_s))


@compiled
def fibre_v(position_um: float, constants: Record) -> float:
    """Return the light at a displacement, in V; it is zero if the mirror touches the probe.

    Args:
        position_um: Displacement from rest, away from the probe, in µm.
        constants: Constants of the plant.
    """
    c = constants[0]
    gap_um = max(c.rest_gap_um + position_um, 0.0)
    bend = (gap_um / c.peak_gap_um) ** 3 / 2.0
    return float(c.slope_v_per_um * gap_um / (1.0 + bend))


@compiled
def fibre_slope(position_um: float, constants: Record) -> float:
    """Return the slope of `fibre_v`, in V/µm."""
    c = constants[0]
    gap_um = c.rest_gap_um + position_um
    if gap_um <= 0.0:
        return 0.0
    bend = (gap_um / c.peak_gap_um) ** 3 / 2.0
    return float(c.slope_v_per_um * (1.0 - 2.0 * bend) / (1.0 + bend) ** 2)


@compiled
def row_product(matrix: Any, number: int, known: Any) -> float:
    """Return the product of one matrix row and a tuple of the same length."""
    total = 0.0
    for i in range(len(known)):
        total += matrix[number, i] * known[i]
    return total


@compiled
def advance_stage(middle_v: float, end_v: float, state: Record, constants: Record) -> None:
    """Advance the stage by one sub-step.

    Args:
        middle_v: Drive across the actuator in the middle of the sub-step, in V.
        end_v: Drive at the end of the sub-step, in V.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    s.gain += c.gain_growth
    at_start = s.gain * s.hysteretic
    middle = min(max(middle_v / c.drive_v, c.lowest), c.highest)
    end = min(max(end_v / c.drive_v, c.lowest), c.highest)
    in_middle = s.gain * hysteresis(middle, end, state, constants)
    at_end = s.gain * s.hysteretic
    s.drive_v = end_v

    mean = (at_start + 4.0 * in_middle + at_end) / 6.0  # Simpson's rule
    crept = 0.0
    for i in range(len(s.lags)):
        s.lags[i] += c.creep_gains[i] * (mean - s.lags[i])
        crept += c.creep_weights[i] * s.lags[i]
    # The return point drifts in proportion to the highest drive, which is forgotten slowly.
    s.swing = max(s.unit, s.swing * c.drift_keep)
    s.drifted += c.drift_gain * (c.drift * s.swing - s.drifted)
    slow_before, s.slow = s.slow, crept + s.drifted

    # The static displacement follows a parabola; the mode responds to it exactly. The lags of the
    # creep reach `creep_at_reference` after 0.1 s, so the quick part is reduced by that amount.
    quick = 1.0 - c.creep_at_reference
    start_um = s.static_um
    middle_um = c.travel_um * (quick * in_middle + (slow_before + s.slow) / 2.0)
    end_um = s.static_um = c.travel_um * (quick * at_end + s.slow)
    known = (s.displacement_um, s.slope_um, start_um, middle_um, end_um)
    s.displacement_um = row_product(c.mode, 0, known)
    s.slope_um = row_product(c.mode, 1, known)
    s.start_slope_um = row_product(c.mode, 2, known)


@compiled
def step_output(goal_v: float, state: Record, constants: Record) -> None:
    """Set the output of an instantaneous amplifier to `goal_v` before the sub-step begins."""
    s, c = state[0], constants[0]
    s.output_v = goal_v
    unit = min(max((goal_v + s.noise_v) / c.drive_v, c.lowest), c.highest)
    value = s.gain * jump(unit, state, constants)
    s.static_um = c.travel_um * ((1.0 - c.creep_at_reference) * value + s.slow)


@compiled
def advance_sensor(noise_v: float, state: Record, constants: Record) -> None:
    """Advance detector and filter over the sub-step of the last `advance_stage`.

    Args:
        noise_v: Noise of the light during the sub-step, in V.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    light_before_v, slope_before = s.light_v, s.light_slope
    s.light_v = fibre_v(s.displacement_um, constants)
    s.light_slope = fibre_slope(s.displacement_um, constants)
    known = (
        s.detector_v,
        s.filter_v,
        s.filter_slope_v,
        light_before_v,
        slope_before * s.start_slope_um,
        s.light_v,
        s.light_slope * s.slope_um,
        noise_v,
    )
    s.detector_v = row_product(c.receiver, 0, known)
    s.filter_v = row_product(c.receiver, 1, known)
    s.filter_slope_v = row_product(c.receiver, 2, known)
    s.newest = (s.newest + 1) % len(s.past_v)
    s.past_v[s.newest] = s.filter_v
    s.past_slope_v[s.newest] = s.filter_slope_v


@compiled
def reading_v(ago: float, state: Record, constants: Record) -> float:
    """Return the converter's reading `ago` sub-steps before the newest, in V."""
    s, c = state[0], constants[0]
    size = len(s.past_v)
    whole = int(ago)
    later = (s.newest - whole) % size  # ring buffer
    earlier = (later - 1) % size
    t = 1.0 - (ago - whole)  # 0 at `earlier`, 1 at `later`: cubic Hermite interpolation
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
    """Advance the plant and return the reading of the sensor's converter, in V.

    Args:
        sub_steps: Number of sub-steps; the noise for them must have been drawn.
        command_v: Commanded voltage during these sub-steps, in V.
        ago: Age of the reported light at the end, in sub-steps: the delay of the sensor.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    goal_v = target_v(command_v, constants)
    if c.instantaneous and sub_steps > 0:  # a step cannot be part of the following parabola
        step_output(goal_v, state, constants)
    for _ in range(sub_steps):
        # Two halves, because the stage needs the drive in the middle of the sub-step too.
        middle_v = output_v(s.output_v, goal_v, constants)
        s.output_v = output_v(middle_v, goal_v, constants)
        noise_before_v = s.noise_v
        # First-order autoregression: white noise in the bandwidth of the amplifier.
        s.noise_v = c.noise_decay * noise_before_v + c.noise_kick_v * s.noise[s.noise_used, 0]
        advance_stage(
            middle_v + (noise_before_v + s.noise_v) / 2.0,
            s.output_v + s.noise_v,
            state,
            constants,
        )
        s.hum_phase += c.hum_angle
        disturbed_v = c.light_noise_v * s.noise[s.noise_used, 1] + c.hum_v * sin(s.hum_phase)
        advance_sensor(disturbed_v, state, constants)
        s.noise_used += 1
    return reading_v(ago, state, constants)
