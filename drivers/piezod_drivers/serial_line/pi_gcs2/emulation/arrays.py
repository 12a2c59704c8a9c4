"""Replies with many values: a header, and a line for each point."""

from collections.abc import Sequence


def array_reply(
    columns: Sequence[tuple[str, Sequence[float]]], sample_time_s: float, number: str
) -> bytes:
    """Return a reply with a column for each table; all lines but the last end with a space.

    Args:
        columns: Name and values of each column.
        sample_time_s: Time between two values, in s.
        number: Format of a value.
    """
    n_values = min(len(values) for _, values in columns)
    header = [
        "VERSION = 1",
        "TYPE = 1",
        "SEPARATOR = 32",
        f"DIM = {len(columns)}",
        f"SAMPLE_TIME = {sample_time_s:.6f}",
        f"NDATA = {n_values}",
        *(f"NAME{i} = {name}" for i, (name, _) in enumerate(columns)),
        "END_HEADER",
    ]
    lines = [f"# {text}" for text in header]
    rows = zip(*(values for _, values in columns), strict=False)
    lines += [" ".join(number.format(value) for value in row) for row in rows]
    return (" \n".join(lines) + "\n").encode()
