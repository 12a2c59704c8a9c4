"""Whether a device can play a table: its shape, interval, size, cycles and values."""

import typing
from collections.abc import Sequence

from piezod.devices.player import EdgeWaits, PlayerCapabilities, Table
from piezod.errors import DeviceError

if typing.TYPE_CHECKING:
    from piezod.devices.player import FloatArray


def check_table(
    table: Table, able: PlayerCapabilities, ranges: Sequence[tuple[float, float]]
) -> None:
    """Check a table before anything is sent.

    Args:
        table: The table.
        able: Capabilities of the player.
        ranges: Lowest and highest value of each output.

    Raises:
        DeviceError: If the device cannot play it.
    """
    interval_ns = table.interval_ns
    if interval_ns <= 0 or able.legal_interval_ns(interval_ns) != interval_ns:
        raise DeviceError(
            f"the interval of a table is {interval_ns} ns, allowed: {able.shortest_interval_ns} to "
            f"{able.longest_interval_ns} ns in steps of {able.interval_step_ns} ns"
        )
    for part, values in (("lead_in", table.lead_in), ("period", table.period)):
        check_values(part, values, ranges)
    if not len(table.period):
        raise DeviceError("the period of a table has no point, allowed: at least 1")
    n_points = len(table.lead_in) + len(table.period)
    shared = able.points_shared and len(ranges) > 1
    if n_points * (len(ranges) if shared else 1) > able.points:
        for_outputs = f" for each of {len(ranges)} outputs" if shared else ""
        raise DeviceError(
            f"a table has {n_points} points{for_outputs}, allowed: at most {able.points}"
            + (" together" if shared else "")
            + "; choose a longer interval"
        )
    _check_pulses(table, able)
    if table.compared is not None and (why := way_problem("device", able.pulses_at)):
        raise DeviceError(why)
    if table.edges is not None:
        _check_edges(table, table.edges, able)
    # A device whose play only the host ends has no limit of its own.
    if table.cycles < 1 or 0 < able.cycles < table.cycles:
        allowed = f"1 to {able.cycles}" if able.cycles else "at least 1"
        raise DeviceError(f"a table has {table.cycles} cycles, allowed: {allowed}")


def _check_pulses(table: Table, able: PlayerCapabilities) -> None:
    if table.pulses is None:
        return
    if table.pulses.shape != (len(table.period),):
        raise DeviceError(
            f"pulses have the shape {table.pulses.shape}, allowed: one for each of the "
            f"{len(table.period)} points of the period"
        )
    highest = int(table.pulses.max()).bit_length()
    if highest > able.pulse_lines:
        raise DeviceError(
            f"pulses are for line {highest}, the device has {able.pulse_lines} lines of pulses; "
            "see the options of its driver"
        )


def _check_edges(table: Table, edges: EdgeWaits, able: PlayerCapabilities) -> None:
    if problem := waits_problem(edges, able.edge_waits):
        raise DeviceError(problem)
    if edges.places[-1] >= len(table.period):
        raise DeviceError(f"a wait is behind the {len(table.period)} points of the period")
    if len(table.lead_in) or table.cycles != 1:
        raise DeviceError(
            f"a table that waits for edges has {len(table.lead_in)} points of lead-in and "
            f"{table.cycles} cycles, allowed: 0 and 1"
        )


def waits_problem(edges: EdgeWaits, most: int) -> str:
    """Return why a device cannot wait for edges; empty if it can. Real-time safe.

    Args:
        edges: Where it would wait.
        most: Most waits of the device.
    """
    if not most:
        return (
            "the device does not wait for edges; the simulated stage and a player board do: let "
            "this device pulse instead (pulses)"
        )
    if edges.times > most:
        return f"{edges.times} waits for an edge, allowed on this device: at most {most}"
    return ""


def way_problem(way: str, ways: Sequence[str]) -> str:
    """Return why a device cannot pulse at positions; empty if it can. Real-time safe.

    Args:
        way: "time" or "device".
        ways: Those that it can.
    """
    if way in ways:
        return ""
    if not ways:
        return (
            "the device has no lines for pulses, or only regular ones, as a player board: it does "
            "not pulse at positions; let it pulse in each pixel (pixel)"
        )
    return f"the device does not compare positions itself (got by {way}), allowed: {ways[0]}"


def check_values(part: str, values: "FloatArray", ranges: Sequence[tuple[float, float]]) -> None:
    """Check the values of a part of a table, shape (points, outputs), which the texts name.

    Raises:
        DeviceError: If there is not one column for each output, or a value is out of range.
    """
    if values.ndim != 2 or values.shape[1] != len(ranges):
        raise DeviceError(f"{part} has the shape {values.shape}, allowed: (points, {len(ranges)})")
    for i, (low, high) in enumerate(ranges):
        column = values[:, i]
        inside = (column >= low) & (column <= high)  # NaN is outside
        if not inside.all():
            point = int(inside.argmin())
            raise DeviceError(
                f"point {point} of {part} of output {i} is {column[point]:g}, "
                f"allowed range {low:g} to {high:g}"
            )
