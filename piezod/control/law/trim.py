"""Slow integral action on the measured error, for the part that the inverse model misses.

The trim is added to the normalised command before the inverse model. The stage does what the
inverse model requests, so that the gain between them is one, whatever the hysteresis. The gain of
the integral is therefore a rate: an error decays with the time constant 1/gain. `stability` in this
folder decides which gains are safe. The paper has no trim.
"""


class Trim:
    """A displacement, in units of the range, that removes the measured error. Real-time safe.

    It starts disabled, at zero.

    Args:
        gain_per_s: Gain of the integral, in 1/s, positive.
        period_s: Period of the loop, in s.
        authority: Largest trim in either direction, as a share of the range.
        fade_cycles: Cycles over which the full authority fades after `disable`; at least 1.
        refusal: Why this gain is not safe on this axis; empty if it is.
    """

    def __init__(
        self,
        gain_per_s: float,
        period_s: float,
        authority: float,
        fade_cycles: int,
        refusal: str = "",
    ) -> None:
        self._gain_per_cycle = gain_per_s * period_s
        self._authority = authority
        self._fade_per_cycle = authority / fade_cycles
        self._enabled = False
        self.refusal = refusal
        """Why mode `trimmed` must not be selected; empty if it may."""
        self.gain_halved = False
        """Whether it integrates with half its gain."""
        self.active = False
        """Whether the trim can differ from zero: it is enabled, or still fades."""
        self.value = 0.0
        """Present trim, within plus and minus the authority."""

    def enable(self) -> None:
        """Integrate from the present trim on, which is zero unless it still fades."""
        self._enabled = self.active = True

    def disable(self) -> None:
        """Let the trim fade to zero."""
        self._enabled = False

    def step(self, error: float, valid: bool, limited: int) -> float:
        """Return the trim for the next command. Call once per cycle while `active`.

        Args:
            error: Command minus position at the instant of the sample, in units of the range.
            valid: Whether the sample may be used; if not, or if the error is not finite, the trim
                stays.
            limited: 1 while drive or command can go no higher, -1 while they can go no lower, else
                0. An error that pushes further in that direction is not integrated (anti-windup).
        """
        if not self._enabled:
            self.value -= min(max(self.value, -self._fade_per_cycle), self._fade_per_cycle)
            self.active = self.value != 0.0
        elif valid and error - error == 0.0 and error * limited <= 0.0:
            gain = self._gain_per_cycle / 2.0 if self.gain_halved else self._gain_per_cycle
            requested = self.value + gain * error
            self.value = min(max(requested, -self._authority), self._authority)
        return self.value
