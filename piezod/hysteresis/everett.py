"""A smooth Everett surface: the change of displacement between two drives of a Preisach model.

While the drive of a stage rises from a minimum β to α, its displacement rises by E(α, β); while the
drive falls from a maximum α to β, it falls by the same amount. A Preisach model is its Everett
function E on the triangle 0 ≤ β ≤ α ≤ 1. Here E is a polynomial in the square root of the width D
and in the middle of the loop, linear in its 24 coefficients:

    E(α, β) = Σ_{i<6, j<4} c_ij D P_i(2√D - 1) P_j(α + β - 1),   D = α - β,

with the Legendre polynomials P_n. The powers D, D^1.5, D², … of the width follow the density of
real stages, which is large for narrow loops. The factor D makes E vanish on the diagonal.

The rising branch has the slope ∂E/∂α, the falling one -∂E/∂β:

    R = Σ c_ij (G_i P_j + D P_i P_j'),   F = Σ c_ij (G_i P_j - D P_i P_j'),   G_i = P_i + √D P_i'.

Source: Mayergoyz, Mathematical Models of Hysteresis (1991), sections 1.2 and 1.3, for the Everett
function. The paper has no such model.
"""

from math import sqrt

from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

N_WIDTHS, N_MIDDLES = 6, 4
"""Number of polynomials in the width and in the middle of a loop."""
SIZE = N_WIDTHS * N_MIDDLES
"""Number of coefficients; coefficient c_ij is number 4 i + j."""


@compiled
def _legendre(x: float) -> tuple[float, float, float, float, float, float]:
    """Return P_0 to P_5."""
    p2 = 1.5 * x * x - 0.5
    p3 = (5.0 * x * p2 - 2.0 * x) / 3.0
    p4 = (7.0 * x * p3 - 3.0 * p2) / 4.0
    return 1.0, x, p2, p3, p4, (9.0 * x * p4 - 4.0 * p3) / 5.0


@compiled
def fill_basis(upper: float, lower: float, basis: FloatArray) -> None:
    """Write the factor of each coefficient in E(upper, lower), shape (24,). Real-time safe."""
    width = max(upper - lower, 0.0)
    of_width = _legendre(2.0 * sqrt(width) - 1.0)
    of_middle = _legendre(upper + lower - 1.0)
    place = 0
    for i in range(N_WIDTHS):
        for j in range(N_MIDDLES):
            basis[place] = width * of_width[i] * of_middle[j]
            place += 1


@compiled
def surface(coefficients: FloatArray, upper: float, lower: float) -> tuple[float, float, float]:
    """Return E, the slope of the rising branch and that of the falling branch. Real-time safe."""
    width = max(upper - lower, 0.0)
    root, x, y = sqrt(width), 2.0 * sqrt(width) - 1.0, upper + lower - 1.0
    p = _legendre(x)
    # P'_{n+1} = (2 n + 1) P_n + P'_{n-1}
    d2, d3 = 3.0 * x, 5.0 * p[2] + 1.0
    d4 = 7.0 * p[3] + d2
    derivatives = (0.0, 1.0, d2, d3, d4, 9.0 * p[4] + d3)
    q2, e3 = 1.5 * y * y - 0.5, 7.5 * y * y - 1.5
    q3, e2 = (5.0 * y * q2 - 2.0 * y) / 3.0, 3.0 * y
    value, common, skew = 0.0, 0.0, 0.0
    for i in range(N_WIDTHS):
        k = N_MIDDLES * i
        c0, c1, c2, c3 = (
            coefficients[k],
            coefficients[k + 1],
            coefficients[k + 2],
            coefficients[k + 3],
        )
        level = c0 + c1 * y + c2 * q2 + c3 * q3
        value += p[i] * level
        common += (p[i] + root * derivatives[i]) * level
        skew += p[i] * (c1 + c2 * e2 + c3 * e3)
    return width * value, common + width * skew, common - width * skew
