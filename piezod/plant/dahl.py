"""The state of a Dahl stage along a monotonic move, compiled, in closed form.

    dg = dv·(1 - g/g_s·sign(dv))²

With g = h/α and the drive v; `path.py` has the displacement. 1 - g/g_s, the distance to the
saturation, falls with the inverse of the way, and not exponentially.
"""

from piezod.jit import compiled


@compiled
def approached(g: float, rise: float, saturated: float) -> float:
    """Return g after v has risen; a fall is the same for -g.

    Args:
        g: At the start.
        rise: Change of v in nominal drives, not negative.
        saturated: g_s.
    """
    distance = 1.0 - g / saturated
    return saturated * (1.0 - distance / (1.0 + distance * rise / saturated))
