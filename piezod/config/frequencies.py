"""How fast a waveform may be for a loop, and what the loop makes of a fast one.

A loop writes a voltage once in a period T and holds it. A sine of frequency f becomes a staircase:
its steps reach sin(π f T) of the peak-to-peak swing, and between two writes it is off by half a
period on average, 180° f T. From half of the rate on, the samples are those of a slower sine.
"""

from collections.abc import Iterator, Mapping
from math import pi, sin
from typing import Final

from piezod.config.waveforms.combined import WaveformConfig

NYQUIST_SHARE: Final = 0.5
"""Frequencies from this share of the rate on are refused."""
COARSE_SHARE: Final = 0.1
"""Frequencies above this share of the rate give a warning."""


def too_fast(highest_hz: float, rate_hz: float) -> str:
    """Return why a loop cannot make a waveform, or "".

    Args:
        highest_hz: Highest frequency of the waveform, in Hz.
        rate_hz: Cycles of the loop per second.
    """
    allowed_hz = NYQUIST_SHARE * rate_hz
    if highest_hz < allowed_hz:
        return ""
    return (
        f"too fast for the loop (got {highest_hz:g} Hz), allowed: below {allowed_hz:g} Hz, half "
        f"of rate_hz; a tenth, {COARSE_SHARE * rate_hz:g} Hz, gives a smooth motion"
    )


def coarse(waveforms: Mapping[str, WaveformConfig], rate_hz: float) -> Iterator[str]:
    """Yield a warning for each waveform that the loop makes in few steps a period.

    Args:
        waveforms: The waveforms by the name of their axis.
        rate_hz: Cycles of the loop per second.
    """
    for axis, waveform in waveforms.items():
        share = waveform.highest_hz() / rate_hz
        if share > COARSE_SHARE:
            yield (
                f"axis {axis}: {share * rate_hz:g} Hz is more than a tenth of the rate, "
                f"{rate_hz:g} Hz: the loop makes {1.0 / share:.3g} steps a period, which are up to "
                f"{100.0 * sin(pi * share):.0f} % of the swing, and its phase is off by "
                f"{180.0 * share:.2g}° on average between two cycles, besides the delay of "
                "amplifier and stage. Use a lower frequency or a higher rate_hz."
            )
