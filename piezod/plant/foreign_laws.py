"""Classes of hysteresis from the literature that are not those of any model of piezod.

As in `laws.py`, a class gives the hysteretic part of the displacement, and drives are in nominal
drives. All parameters were fixed before any compensation was tried on these stages.
"""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from piezod.plant.ranges import ParameterRange

PINNING = 4e-5
"""Oscillation of the drive that leaves the path classes as they are, as in `laws.BoucWen`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColemanHodgdon:
    """dy = α |du| (f - y) + g du, f = tanh(k s)/k, g = f' (1 - c exp(-s²/d²)), s = u - ½.

    B. D. Coleman and M. L. Hodgdon, Int. J. Eng. Sci. 24 (1986) 897; for piezo actuators H. J. M.
    T. A. Adriaens, W. L. de Koning and R. Banning, IEEE/ASME Trans. Mechatronics 5 (2000) 331. With
    a straight f and a constant g it would be the equation of `BoucWen`; here both bend.
    """

    attraction: Annotated[float, ParameterRange("", 0.5, 20, "α, per nominal drive")] = 4.0
    bend: Annotated[float, ParameterRange("", 0.1, 3, "k: how much f saturates")] = 0.8
    cut: Annotated[float, ParameterRange("", 0, 0.6, "c: what g lacks of f' in the middle")] = 0.5
    spread: Annotated[float, ParameterRange("", 0.1, 10, "d, nominal drives")] = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Duhem:
    """y = u - Σ c_i h_i with dh_i = du - a_i |du| h_i, where rise and fall have their own a_i.

    A semilinear Duhem model with two states: J. Oh and D. S. Bernstein, IEEE Trans. Automatic
    Control 50 (2005) 631. Its branches are not mirrored, and it forgets over two lengths of path.
    """

    rising_slow: Annotated[float, ParameterRange("", 0.5, 30, "a₁ of a rise")] = 1.6
    falling_slow: Annotated[float, ParameterRange("", 0.5, 30, "a₁ of a fall")] = 2.2
    rising_quick: Annotated[float, ParameterRange("", 0.5, 60, "a₂ of a rise")] = 9.0
    falling_quick: Annotated[float, ParameterRange("", 0.5, 60, "a₂ of a fall")] = 12.0
    slow_share: Annotated[float, ParameterRange("", 0, 0.4, "c₁")] = 0.3
    quick_share: Annotated[float, ParameterRange("", 0, 0.2, "c₂")] = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class MaxwellSlip:
    """Generalised Maxwell slip: ten springs with friction, y = u - Σ F_i.

    An element sticks, dF = du/10, until |F| reaches its limit s(u') δ_i/10; then it slips, and F
    approaches this limit with a rate of its own until the drive turns. s falls from 1 + e at rest
    to 1 at speed (Stribeck): the loops are narrower in fast motion. F. Al-Bender, V. Lampaert and
    J. Swevers, IEEE Trans. Automatic Control 50 (2005) 1883; for piezo actuators, without the
    speed, M. Goldfarb and N. Celanovic, IEEE Control Systems 17 (1997) 69.
    """

    slip_length: Annotated[
        float, ParameterRange("", 0.05, 1, "δ₁₀, the move to slip of the last, nominal drives")
    ] = 0.5
    slip_grading: Annotated[float, ParameterRange("", 0.5, 4, "δ_i = δ₁₀ (i/10)^slip_grading")] = (
        1.5
    )
    static_excess: Annotated[float, ParameterRange("", 0, 1, "e: static beyond sliding limit")] = (
        0.2
    )
    stribeck_per_s: Annotated[
        float, ParameterRange("1/s", 0.01, 100, "rate at which e has decayed, nominal drives")
    ] = 2.0
    slip_hz: Annotated[
        float, ParameterRange("1/s", 0.1, 1000, "rate at which a slipping force approaches")
    ] = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RatePlays:
    """Twenty generalised plays whose thresholds grow with the rate of the drive.

    w = max(γ_r(u) - r, min(γ_l(u) + r, w)), r = r_j (1 + growth log10(1 + |u'|/reference)), and
    y = Σ exp(-τ r_j) w_j. M. Al Janaideh, S. Rakheja and C.-Y. Su, IEEE/ASME Trans. Mechatronics 16
    (2011) 734 (density; envelopes γ = tanh); M. Al Janaideh and P. Krejčí, IEEE/ASME Trans.
    Mechatronics 18 (2013) 1498 (thresholds that grow with the rate). The logarithm is ours: loops
    of measured stages widen with the logarithm of the rate. Without saturation γ(u) = u.
    """

    widest: Annotated[float, ParameterRange("", 0.05, 1, "largest threshold, nominal drives")] = 0.5
    thinning: Annotated[float, ParameterRange("", 0, 20, "τ of the density, per nominal drive")] = (
        4.0
    )
    growth: Annotated[
        float, ParameterRange("", 0, 1, "growth of the thresholds per decade of rate")
    ] = 0.15
    reference_per_s: Annotated[
        float, ParameterRange("1/s", 1e-3, 100, "rate of the first growth", varies=False)
    ] = 0.1
    saturation: Annotated[
        float, ParameterRange("", 0, 3, "of the envelope γ_r, per nominal drive")
    ] = 0.0
    steeper: Annotated[float, ParameterRange("", 0, 0.5, "how much steeper γ_l is, as a share")] = (
        0.0
    )


ForeignLaw: TypeAlias = ColemanHodgdon | Duhem | MaxwellSlip | RatePlays
