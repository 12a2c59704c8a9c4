"""Slow integral action on the measured error, for the part that the inverse model misses.

The trim is added to the normalised command before the inverse model. The stage does what the
inverse model requests, so that the gain between them is one, whatever the hysteresis. The gain of
the integral is therefore a rate: an error decays with the time constant 1/gain. `trim_gains` in
this folder decides which gains are safe. The paper has no trim.

With a proportional gain, a share of the error is added at once. Notches keep the modes of the stage
out of the error. Together they allow a larger gain of the integral.
"""

from collections.abc import Sequence

from piezod.dynamics.notch import Notch


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
        """Why its mode must not be selected; empty if it may."""
        self.gain_halved = False
        """Whether it integrates with half its gain."""
        self.active = False
        """Whether the trim can differ from zero: it is enabled, or still fades."""
        self.value = 0.0
        """Present trim, within plus and minus the authority, or on its way there."""

    def take_over(self, other: "Trim") -> None:
        """Go on from the trim of another mode, which ends; there is no jump."""
        self.value, self.active = other.value, other.active
        other.drop()

    def drop(self) -> None:
        """End at once: another trim goes on from this one."""
        self.value, self.active, self._enabled = 0.0, False, False

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
            self._go_to(self.value + gain * error)
        return self.value

    def _go_to(self, requested: float) -> None:
        """Take a trim within the authority; one that was taken over fades until it is."""
        most = max(self._authority, abs(self.value) - self._fade_per_cycle)
        self.value = min(max(requested, -most), most)


class NotchedTrim(Trim):
    """A trim with a proportional gain and notches. Real-time safe.

    The change of the filtered error is added in each cycle, which sums up to the error itself. So
    neither a change of mode nor one of the gains makes a jump. After an invalid sample the error
    starts anew.

    Args:
        gain_per_s, period_s, authority, fade_cycles, refusal: As for `Trim`.
        proportional: Share of the error that is added.
        notches: Filters of the error.
    """

    def __init__(
        self,
        gain_per_s: float,
        period_s: float,
        authority: float,
        fade_cycles: int,
        refusal: str = "",
        *,
        proportional: float,
        notches: Sequence[Notch],
    ) -> None:
        super().__init__(gain_per_s, period_s, authority, fade_cycles, refusal)
        self._proportional, self._notches = proportional, tuple(notches)
        self._states = [(0.0, 0.0)] * len(self._notches)
        self._before = 0.0
        self._known = False  # whether the error before this one is known

    def enable(self) -> None:
        """Integrate from the present trim on; an error of the past does not count."""
        if not self._enabled:
            self._known = False
        super().enable()

    def step(self, error: float, valid: bool, limited: int) -> float:
        """Return the trim for the next command, as `Trim` does."""
        if not (self._enabled and valid and error - error == 0.0):
            self._known = False
            return super().step(error, False, limited)
        error = min(max(error, -1.0), 1.0)  # a larger one would stay in the filters for long
        if not self._known:
            self._settle(error)
        filtered = self._filtered(error)
        change, self._before = filtered - self._before, filtered
        halved = 0.5 if self.gain_halved else 1.0
        requested = self.value + halved * self._proportional * change
        if filtered * limited <= 0.0:
            requested += halved * self._gain_per_cycle * filtered
        self._go_to(requested)
        return self.value

    def _settle(self, error: float) -> None:
        """Start with an error that has been the same for long."""
        for i, each in enumerate(self._notches):
            second = (each.b2 - each.a2) * error  # the static gain is one
            self._states[i] = (each.b1 - each.a1) * error + second, second
        self._before, self._known = error, True

    def _filtered(self, error: float) -> float:
        """Return the error behind all notches (direct form II, transposed)."""
        for i, (b0, b1, b2, a1, a2) in enumerate(self._notches):
            first, second = self._states[i]
            output = b0 * error + first
            self._states[i] = b1 * error - a1 * output + second, b2 * error - a2 * output
            error = output
        return error
