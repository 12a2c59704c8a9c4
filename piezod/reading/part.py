"""Paths that name a part of a file, as in `file.h5:/group` or `file.xlsx:/Sheet2`."""

from pathlib import Path


def split_path(path: Path) -> tuple[Path, str]:
    """Return the path of a file, and the part of it that the text behind a colon names, or ""."""
    text = str(path)
    name, colon, part = text.rpartition(":/")
    if colon and not path.exists():
        return Path(name), f"/{part}"
    return path, ""
