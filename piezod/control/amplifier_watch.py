"""Watches the amplifier of one axis: what it takes, and whether it does what it was told.

Detects A1 to A9, A11 and A12.
"""

from collections.abc import Sequence
from typing import Final

from piezod.control.fault_register import Detection
from piezod.control.limits import Limits
from piezod.devices.status import Flags

_NOTHING: Final[Sequence[Detection]] = ()


class AmplifierWatch:
    """Watches one channel; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        limits: What its drive may do.
        delay_ns: How long the displacement lags behind the voltage; the output lags by no more.
        period_ns: Period of the loop.
    """

    def __init__(self, axis: int, limits: Limits, delay_ns: int, period_ns: int) -> None:
        self._axis, self._limits = axis, limits

    def check(self, read_back_v: float, flags: Flags) -> Sequence[Detection]:
        """Return what is wrong with the channel; call it once in each cycle, before the write.

        May be called in the loop.

        Args:
            read_back_v: Voltage that the amplifier tells is in force now, NaN where it does not.
            flags: What the device says is the matter.
        """
        return _NOTHING

    def wrote(
        self,
        drive_v: float,
        *,
        taken: bool,
        refused: bool = False,
        range_limited: bool = False,
        slew_limited: bool = False,
    ) -> None:
        """Learn what became of the write of this cycle; only where one was tried, not in shadow.

        May be called in the loop.

        Args:
            drive_v: Voltage that was sent, finite.
            taken: Whether the amplifier took it.
            refused: Whether the guard refused what was asked for, as not finite.
            range_limited: Whether more was wanted than the range allows.
            slew_limited: Whether more was wanted than the slew rate allows.
        """

    def forget(self) -> None:
        """Forget what was written: from here on the amplifier is taken over from its read-back.

        May be called in the loop: before arming, when the link is back, after a cut or deactivation.
        """
