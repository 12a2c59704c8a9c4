"""The two records of the compiled kernel: constants and state.

A record costs one argument per call of the kernel, for any number of fields. Inside the kernel its
fields have names.
"""

from math import exp, expm1, inf, pi, sqrt
from typing import Any, Final

import numpy as np

from piezod.plant.density import NODES, everett_table
from piezod.plant.discretise import creep, mode, receiver
from piezod.plant.fibre import BEST_GAP, peak_gap_um
from piezod.plant.foreign import FACTS, INNER, foreign_constants
from piezod.plant.foreign_laws import ColemanHodgdon, Duhem, MaxwellSlip, RatePlays
from piezod.plant.kernel import fibre_slope, fibre_v
from piezod.plant.laws import BoucWen, Dahl, HysteresisLaw, PowerLaw, ThermalRelays
from piezod.plant.parameters import AmplifierParameters, PlantParameters, SensorParameters
from piezod.plant.path import bouc_wen_constants, dahl_constants
from piezod.plant.preisach import POWER_LAW, TABLE, everett
from piezod.plant.relays import CELLS, RELAYS, relay_constants

MAX_TURNS: Final = 512
"""Turning points that the stage stores; a full list loses its innermost pair."""
DELAY_BUFFER: Final = 256
"""Sub-steps of filtered light that are stored for the delay."""
NOISE_BLOCK: Final = 128
"""Sub-steps for which noise is drawn at once."""
OVERDRIVE: Final = 0.2
"""Range beyond 0 and the nominal drive in which the stage still moves, in nominal drives."""
_LOWEST: Final = -OVERDRIVE
_HIGHEST: Final = 1 + OVERDRIVE

CONSTANTS: Final = np.dtype(
    [
        ("dac_step_v", "f8"),  # 0: no quantisation
        ("dac_limit_v", "f8"),
        ("nominal_gain", "f8"),
        ("gain", "f8"),
        ("output_min_v", "f8"),
        ("output_max_v", "f8"),
        ("instantaneous", "i8"),
        ("half_step_s", "f8"),
        ("slew_v_per_s", "f8"),
        ("slew_ends_v", "f8"),  # distance to the target below which the lag limits the speed
        ("lag_s", "f8"),
        ("half_decay", "f8"),
        ("noise_decay", "f8"),
        ("noise_kick_v", "f8"),
        ("drive_v", "f8"),
        ("lowest", "f8"),
        ("highest", "f8"),
        ("reversible", "f8"),
        ("irreversible", "f8"),
        ("exponent", "f8"),
        ("skew", "f8"),
        ("gain_growth", "f8"),  # per sub-step
        ("travel_um", "f8"),
        ("creep_weights", "f8", (13,)),  # one for each lag, see `discretise.creep`
        ("creep_gains", "f8", (13,)),
        ("creep_at_reference", "f8"),
        ("drift", "f8"),
        ("drift_gain", "f8"),
        ("drift_keep", "f8"),  # factor of the peak drive per sub-step
        ("mode", "f8", (3, 5)),  # rows of `discretise.mode`
        ("slope_v_per_um", "f8"),
        ("peak_gap_um", "f8"),
        ("rest_gap_um", "f8"),
        ("light_noise_v", "f8"),
        ("receiver", "f8", (3, 8)),  # rows of `discretise.receiver`
        ("adc_step_v", "f8"),  # 0: no quantisation
        ("saturation_v", "f8"),
        ("law", "i8"),  # class of hysteresis; the fields below are 0 for the other classes
        ("alpha", "f8"),  # of Bouc-Wen and Dahl, like the next three
        ("pinning", "f8"),
        ("g_at_rest", "f8"),
        ("part_at_nominal", "f8"),
        ("beta", "f8"),  # of Bouc-Wen, like the next two
        ("gamma", "f8"),
        ("bouc_wen_exponent", "f8"),
        ("saturated", "f8"),  # of Dahl
        ("attempts", "f8"),  # of the relays, per sub-step
        ("activation", "f8"),
        ("cell", "f8", (CELLS,)),  # drive in the middle of each cell
        ("spread", "f8", (CELLS,)),
        ("relay_weight", "f8", (CELLS, CELLS)),
        ("relays_at_rest", "f8", (CELLS, CELLS)),
        ("part_at_rest", "f8"),
        ("facts", "f8", (FACTS,)),  # of the classes of `foreign.py`, like the next one
        ("inner_at_rest", "f8", (INNER,)),
        ("step_s", "f8"),
        ("hum_v", "f8"),
        ("hum_angle", "f8"),  # per sub-step
        ("everett_table", "f8", (NODES, NODES)),
    ]
)

STATE: Final = np.dtype(
    [
        ("output_v", "f8"),  # output of the amplifier, without its noise
        ("noise_v", "f8"),
        ("drive_v", "f8"),  # across the actuator
        ("unit", "f8"),  # drive across the actuator, in nominal drives
        ("hysteretic", "f8"),  # displacement by the hysteresis at a gain of 1, in travels
        ("gain", "f8"),
        ("depth", "i8"),
        ("dropped", "i8"),
        ("turn_at", "f8", (MAX_TURNS,)),  # drive at each turning point, in nominal drives
        ("turn_value", "f8", (MAX_TURNS,)),  # displacement there, in travels
        ("lags", "f8", (13,)),
        ("swing", "f8"),  # peak of the drive that decays with time
        ("drifted", "f8"),
        ("slow", "f8"),  # creep and drift together, in travels
        ("static_um", "f8"),
        ("displacement_um", "f8"),
        ("slope_um", "f8"),  # per sub-step, like all slopes here
        ("start_slope_um", "f8"),  # at the start of the last sub-step
        ("light_v", "f8"),  # at the present displacement
        ("light_slope", "f8"),  # likewise, in V/µm
        ("detector_v", "f8"),
        ("filter_v", "f8"),
        ("filter_slope_v", "f8"),
        ("newest", "i8"),  # index in the ring of filtered light
        ("past_v", "f8", (DELAY_BUFFER,)),
        ("past_slope_v", "f8", (DELAY_BUFFER,)),
        ("noise_used", "i8"),  # sub-steps of the block whose noise has been used
        ("noise", "f8", (NOISE_BLOCK, 2)),
        ("v", "f8"),  # of Bouc-Wen and Dahl, like the next one
        ("g", "f8"),
        ("part", "f8"),  # of the relays, since rest
        ("up", "f8", (CELLS, CELLS)),  # fraction of each relay that is up
        ("relays_down", "f8", (CELLS,)),  # rates, for use within a sub-step
        ("inner", "f8", (INNER,)),  # of the classes of `foreign.py`, like the next one
        ("rate", "f8"),  # of the drive, in nominal drives per s
        ("hum_phase", "f8"),
    ]
)


def constants(parameters: PlantParameters, step_s: float) -> Any:
    """Return the constants of a plant for its kernel.

    Returns:
        (1,) record of `CONSTANTS`.
    """
    record = np.zeros(1, CONSTANTS)
    stage = parameters.stage
    lags = creep(stage.creep_per_decade, step_s)
    values = {
        **_amplifier(parameters.amplifier, step_s),
        **_sensor(parameters.sensor, stage.travel_um, step_s),
        **_hysteresis(parameters.hysteresis, step_s),
        "step_s": step_s,
        "drive_v": stage.drive_v,
        "lowest": _LOWEST,
        "highest": _HIGHEST,
        "reversible": stage.reversible_um / stage.travel_um,
        "irreversible": stage.irreversible_um / stage.travel_um,
        "exponent": stage.exponent,
        "skew": stage.skew,
        "gain_growth": stage.gain_growth_per_s * step_s,
        "travel_um": stage.travel_um,
        "creep_weights": lags.weights,
        "creep_gains": lags.gains,
        "creep_at_reference": lags.at_reference,
        "drift": stage.drift,
        "drift_gain": -expm1(-step_s / stage.drift_time_s),
        "drift_keep": exp(-step_s / stage.drift_memory_s),
        "mode": mode(stage.mode_hz, stage.mode_damping, step_s),
    }
    for name, value in values.items():
        record[name] = value
    return record


def _hysteresis(law: HysteresisLaw, step_s: float) -> dict[str, Any]:
    match law:
        case PowerLaw():
            return {"law": POWER_LAW}
        case BoucWen():
            return bouc_wen_constants(law, _HIGHEST)
        case Dahl():
            return dahl_constants(law, _HIGHEST)
        case ColemanHodgdon() | Duhem() | MaxwellSlip() | RatePlays():
            return foreign_constants(law, _HIGHEST)
        case ThermalRelays():
            return {"law": RELAYS, **relay_constants(law, step_s, _LOWEST, _HIGHEST)}
        case _:
            return {"law": TABLE, "everett_table": everett_table(law)}


def _amplifier(parameters: AmplifierParameters, step_s: float) -> dict[str, Any]:
    lag_s = 1 / (2 * pi * parameters.bandwidth_hz)
    # A current limit into a capacitance is a slew limit: dV/dt = I / C.
    current_slew = parameters.current_limit_a / (parameters.capacitance_uf * 1e-6)
    slew = min(parameters.slew_v_per_s, current_slew)
    decay = exp(-step_s / lag_s) if lag_s else 0.0
    bits = parameters.dac_bits
    return {
        "dac_step_v": 0.0 if bits == inf else 2 * parameters.dac_range_v / 2**bits,
        "dac_limit_v": parameters.dac_range_v,
        "nominal_gain": parameters.gain,
        "gain": parameters.gain * (1 + parameters.gain_error),
        "output_min_v": parameters.output_min_v,
        "output_max_v": parameters.output_max_v,
        "instantaneous": slew == inf and not lag_s,
        "half_step_s": step_s / 2,
        "slew_v_per_s": slew,
        "slew_ends_v": inf if slew == inf else slew * lag_s,
        "lag_s": lag_s,
        "half_decay": sqrt(decay),
        "noise_decay": decay,
        # So that the stationary standard deviation is `noise_v`.
        "noise_kick_v": parameters.noise_v * sqrt(1 - decay**2),
    }


def _sensor(parameters: SensorParameters, travel_um: float, step_s: float) -> dict[str, Any]:
    density_v = parameters.noise_nm_per_rthz * 1e-3 * parameters.slope_v_per_um
    bits = parameters.adc_bits
    return {
        "slope_v_per_um": parameters.slope_v_per_um * parameters.light_level,
        "peak_gap_um": peak_gap_um(parameters.nonlinearity, travel_um),
        "rest_gap_um": BEST_GAP * travel_um + parameters.setback_um,
        "light_noise_v": density_v / sqrt(2 * step_s),  # white up to half the rate of sub-steps
        "hum_v": parameters.hum_nm * 1e-3 * parameters.slope_v_per_um,
        "hum_angle": 2 * pi * parameters.hum_hz * step_s,
        "receiver": receiver(parameters.bandwidth_hz, parameters.antialias_hz, step_s),
        "adc_step_v": 0.0 if bits == inf else 2 * parameters.adc_range_v / 2**bits,
        "saturation_v": parameters.saturation_v,
    }


def at_rest(record: Any) -> Any:
    """Return the state of a stage that came down from its highest drive to 0 V long ago.

    Its hysteresis memory is therefore known: the next rise follows the outer branch of the loop.

    Args:
        record: (1,) record of `CONSTANTS`.

    Returns:
        (1,) record of `STATE`.
    """
    state = np.zeros(1, STATE)
    c = record[0]
    state["gain"] = 1.0
    state["v"], state["g"] = c["pinning"], c["g_at_rest"]
    state["up"] = c["relays_at_rest"]
    state["inner"] = c["inner_at_rest"]
    if c["law"] in (POWER_LAW, TABLE):
        _at_rest_turns(state, record)
    # Creep, drift, mode and noise are 0 at rest; only the light is not.
    light_v = fibre_v(0.0, record)
    state["light_slope"] = fibre_slope(0.0, record)
    for name in ("light_v", "detector_v", "filter_v", "past_v"):
        state[name] = light_v
    return state


def _at_rest_turns(state: Any, record: Any) -> None:
    c = record[0]
    # Displacement is 0 at 0 V on the way down; the values at both ends follow from that.
    top = everett(c["highest"], 0.0, record)
    bottom = top - everett(c["highest"], c["lowest"], record)
    state["depth"] = 3
    state["turn_at"][0, :3] = c["lowest"], c["highest"], 0.0
    state["turn_value"][0, :3] = bottom, top, 0.0
