"""Write the tables and the gallery of `docs/measurements.md` anew: `python -m docs.measured`."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from docs.measured.gallery import gallery
from docs.measured.tables import PAGE, filled, names, peers, soak, stored
from tests.evidence import evidence

MADE: Final[Mapping[str, Callable[[], Iterable[str]]]] = {
    "peers": peers,
    "soak": soak,
    "evidence": evidence,
    "gallery": gallery,
}
"""What is no stored table."""


def appendix() -> str:
    """Return the page with everything between its marks written anew."""
    text = PAGE.read_text(encoding="utf-8")
    for name in names(text):
        text = filled(text, name, MADE[name]() if name in MADE else stored(name))
    return text


def main() -> None:
    """Write the page."""
    PAGE.write_text(appendix(), encoding="utf-8")


if __name__ == "__main__":
    main()
