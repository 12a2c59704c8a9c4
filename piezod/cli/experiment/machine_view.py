"""How `piezod check --machine` tells what this machine can do."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from piezod.daemon.loop.machine import Machine

_BAR: int = 40
"""Width of the longest bar of the histogram, in characters."""


def print_machine(console: "Console", measured: "Machine") -> None:
    """Print the time of a cycle, the lateness, and the highest rate."""
    console.print(
        f"A cycle that drives takes {measured.cycle_us:.0f} µs without its devices. At the "
        f"configured rate {measured.skipped_part:.2%} of the cycles were skipped.",
        soft_wrap=True,
    )
    cycles = sum(measured.late_us.values())
    for limit, number in measured.late_us.items():
        bar = "#" * max(round(_BAR * number / cycles), 1)
        name = "later" if limit == "more" else f"up to {limit} µs late"
        console.print(f"  {name:>22} {number / cycles:8.2%} {bar}")
    console.print(
        f"The kernel leaves {measured.throttle_part:.0%} of the time to real-time threads. Highest "
        f"rate, without the time of the devices: {measured.rate_hz} Hz (`piezod probe` tells that "
        "of the devices).",
        soft_wrap=True,
    )
    if measured.missing:
        missing = ", ".join(measured.missing)
        console.print(f"This user did not get: {missing}; the service does.", soft_wrap=True)
