"""Classes of hysteresis of the simulated stage, with their parameters.

Each class describes the hysteretic part of the displacement, as a fraction of its own value at the
nominal drive. `StageParameters.irreversible_um` scales that part; `reversible_um` is a linear part
beside it. Drives are in nominal drives: 1 is the drive of the full travel.

The numbers were chosen before any compensation was tried on these stages. They follow the catalogue
of Physik Instrumente (Piezo Tutorial, "Hysteresis: Open-Loop Piezo Operation"): the width of a loop
begins around 2 % at small signals and grows to a maximum of 10 to 15 % at large signals. So the
parameters of a class let the width grow with the swing, and the share of the hysteretic part (in
`variants.py`) makes it 15 % at full swing.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from piezod.plant.foreign_laws import ForeignLaw
from piezod.plant.ranges import ParameterRange

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerLaw:
    """Preisach model whose Everett function has a power of the swing.

    Its parameters are `exponent` and `skew` of the stage.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialDensity:
    """Preisach model with exp(-(α-β)/decay + asymmetry·((α+β)/2 - 1/2)) as its density.

    With a decay of 0.5 the loop is 3 % wide at a swing of 5 %, and 11 % at a swing of 30 %. With an
    asymmetry of 2.15 the branches of the full loop differ by 15 % of the travel, about as on the
    measured scanner of variant `afm`.
    """

    decay: Annotated[
        float, ParameterRange("", 0.05, 1, "width α-β at which the density is 1/e, nominal drives")
    ] = 0.5
    asymmetry: Annotated[
        float, ParameterRange("", 0, 4, "logarithm of the growth of the density to the full drive")
    ] = 0.0

    def density(self, width: Array, middle: Array) -> Array:
        """Return the density of relays, to a constant factor.

        Args:
            width: α-β in nominal drives, not negative.
            middle: (α+β)/2 in nominal drives.
        """
        return np.exp(-width / self.decay + self.asymmetry * (middle - 0.5))


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianDensity:
    """Preisach model with log-normal coercive and Gaussian bias drives.

    The two densities are those of the homogenised energy model (R. C. Smith, S. Seelecke,
    Z. Ounaies, J. Smith, J. Intell. Mater. Syst. Struct. 14, 2003). Unlike in the other classes
    few relays are narrow: the loop is 0.5 % wide at a swing of 5 %, and 10 % at a swing of 30 %.
    """

    median_coercive: Annotated[
        float, ParameterRange("", 0.01, 1, "median of (α-β)/2, nominal drives")
    ] = 0.2
    coercive_spread: Annotated[
        float, ParameterRange("", 0.1, 2, "standard deviation of ln((α-β)/2)")
    ] = 1.0
    bias_spread: Annotated[
        float, ParameterRange("", 0.1, 10, "standard deviation of (α+β)/2, nominal drives")
    ] = 0.5

    def density(self, width: Array, middle: Array) -> Array:
        """Return the density of relays, to a constant factor.

        Args:
            width: α-β in nominal drives, positive.
            middle: (α+β)/2 in nominal drives.
        """
        coercive = np.log(width / 2 / self.median_coercive) / self.coercive_spread
        bias = (middle - 0.5) / self.bias_spread  # symmetrical about half the nominal drive
        return np.exp(-(coercive**2 + bias**2) / 2) / width


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalRelays:
    """Relays that switch with a rate of exp((|h|-hc)/w), h from the middle of each relay.

    The density of the relays is exponential, as in `ExponentialDensity`. Thermally activated relays
    explain after-effect and rate dependence (I. D. Mayergoyz, Mathematical Models of Hysteresis).
    `activation` lets the loop widen by 1 to 2 % of the swing per decade of rate.
    """

    decay: Annotated[
        float, ParameterRange("", 0.05, 1, "width α-β at which the density is 1/e, nominal drives")
    ] = 0.5
    activation: Annotated[
        float, ParameterRange("", 0.004, 0.1, "drive w that changes a rate by e, nominal drives")
    ] = 0.009
    # So that the loop at 1 Hz is about that of relays without thermal activation.
    attempts_hz: Annotated[
        float, ParameterRange("1/s", 1, 1e5, "rate of switching of a relay at its threshold")
    ] = 300.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWen:
    """Hysteresis x = k·u - h with dh = α·du - (β·|du|·h + γ·du·|h|)·|h/h_s|^(n-1).

    h_s = α/(β+γ) is the saturation of h. With n = 1 the equation is that of T. S. Low and W. Guo,
    J. Microelectromech. Syst. 4, 1995, for a piezoelectric actuator. With β = 2 and γ = β/10 the
    loop is then 1.2 % wide at a swing of 5 %, and 7 % at a swing of 30 %. α = (β+γ)/(2β) follows
    from both: just after a turn at saturation the hysteretic part stands still, as for relays.

    A larger n (Y. K. Wen, J. Eng. Mech. 102, 1976) makes the way into the saturation steeper and
    shorter. It hardly relaxes a small h, so that small loops drift for longer.
    """

    beta: Annotated[float, ParameterRange("", 0.5, 20, "β, per nominal drive")] = 2.0
    gamma: Annotated[float, ParameterRange("", 0, 0.4, "γ, per nominal drive")] = 0.2
    exponent: Annotated[
        float, ParameterRange("", 1, 4, "n: the larger, the less a small h relaxes", varies=False)
    ] = 1.0
    # Without it the noise of the amplifier would erase h within a second, at any voltage: |du| adds
    # up the smallest oscillation. 6 mV of 150 V is 7 times that noise.
    pinning: Annotated[
        float, ParameterRange("", 0, 0.01, "oscillation that leaves h as it is, nominal drives")
    ] = 4e-5

    @property
    def alpha(self) -> float:
        """α, for a slope of 0 just after a turn at saturation."""
        return (self.beta + self.gamma) / (2 * self.beta)

    @property
    def saturated(self) -> float:
        """Saturation of h/α, in nominal drives."""
        return 1 / (self.beta + self.gamma)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dahl:
    """Hysteresis x = k·u - h with dh = α·du·(1 - h/h_s·sign(du))², Dahl's equation of friction.

    The equation is that of P. R. Dahl, A Solid Friction Model (Aerospace Corporation, 1968), with
    the exponent 2. As in Bouc-Wen loops do not close at once, but h forgets with the inverse of the
    path and not exponentially. The relaxation of a small h is that of `BoucWen`. α is such that the
    hysteretic part stands still just after a turn of the full loop. The loop is 1.2 % wide at a
    swing of 5 %, and 7 % at a swing of 30 %.
    """

    relaxation: Annotated[
        float, ParameterRange("", 0.5, 10, "relaxation of a small h, per nominal drive")
    ] = 2.0
    pinning: Annotated[
        float, ParameterRange("", 0, 0.01, "oscillation that leaves h as it is, nominal drives")
    ] = 4e-5

    @property
    def alpha(self) -> float:
        """α, from the largest h/h_s of a full loop, which is sqrt(s² + 1) - s."""
        largest = sqrt(self.saturated**2 + 1) - self.saturated
        return float((1 + largest) ** -2)

    @property
    def saturated(self) -> float:
        """s, the saturation of h/α, in nominal drives."""
        return 2 / self.relaxation


HysteresisLaw: TypeAlias = (
    PowerLaw | ExponentialDensity | GaussianDensity | ThermalRelays | BoucWen | Dahl | ForeignLaw
)
