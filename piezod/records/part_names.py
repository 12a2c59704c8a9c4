"""Names of the files of one recording."""


def part_name(name: str, part: int) -> str:
    """Return the name of a file of a recording; the first file has the name of the recording."""
    return name if part == 1 else f"{name}-{part:04d}"
