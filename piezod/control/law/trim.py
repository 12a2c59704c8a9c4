"""Slow integral action on the measured error, for what the inverse model misses.

The trim is added to the normalised command in front of the inverse. What the inverse asks for, the
stage behind it does, so that the gain between is one whatever the hysteresis, and the gain of the
integral is a rate: an error fades with the time constant 1/gain. Which gains are safe,
`piezod.control.law.stability` decides.
"""


class Trim:
    """A displacement, in units of the range, that takes the measured error away.

    It starts disabled, at zero. Plain floats: nothing in here allocates more than its answer.

    Args:
        gain_per_s: Gain of the integral, in 1/s, positive.
        period_s: Period of the loop, in s.
        authority: Most that the trim may add, either way, as a share of the range.
        fade_cycles: Cycles over which the whole authority fades once disabled; at least 1.
    """

    def __init__(
        self, gain_per_s: float, period_s: float, authority: float, fade_cycles: int
    ) -> None:
        self._gain_per_cycle = gain_per_s * period_s
        self._authority = authority
        self._fade_per_cycle = authority / fade_cycles
        self._enabled = False
        self.gain_halved = False
        """Whether it integrates with half its gain."""
        self.active = False
        """Whether `step` can give anything but zero: enabled, or still fading."""
        self.value = 0.0
        """The trim now, within plus and minus the authority."""

    def enable(self) -> None:
        """Integrate from the present trim on, zero unless it still fades; call it in the loop."""
        self._enabled = self.active = True

    def disable(self) -> None:
        """Let the trim fade to zero; may be called in the loop."""
        self._enabled = False

    def step(self, error: float, valid: bool, limited: int) -> float:
        """Return the trim for the next command; may be called in the loop.

        Args:
            error: What the sample lacks to the reference of its own instant, in units of the range.
            valid: Whether the sample may be used; one that may not, or an error that is not finite,
                leaves the trim as it is.
            limited: 1 while the drive or the command can go no higher, -1 while it can go no lower,
                else 0. An error that would push further is not integrated, so nothing winds up.
        """
        if not self._enabled:
            self.value -= min(max(self.value, -self._fade_per_cycle), self._fade_per_cycle)
            self.active = self.value != 0.0
        elif valid and error - error == 0.0 and error * limited <= 0.0:
            gain = self._gain_per_cycle / 2.0 if self.gain_halved else self._gain_per_cycle
            wished = self.value + gain * error
            self.value = min(max(wished, -self._authority), self._authority)
        return self.value
