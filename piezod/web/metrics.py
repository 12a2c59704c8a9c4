"""The metrics of all stages as one text, for Prometheus."""

from collections.abc import Iterable, Iterator
from typing import Final

PLAIN_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"


def joined(texts: Iterable[str]) -> str:
    """Join texts in the format of Prometheus: each metric once, with the samples of all stages."""
    heads: dict[str, list[str]] = {}
    samples: dict[str, list[str]] = {}
    for text in texts:
        known = set(heads)
        for metric, line in _lines(text):
            if not line.startswith("#"):
                samples.setdefault(metric, []).append(line)
            if line.startswith("#") and metric not in known:
                heads.setdefault(metric, []).append(line)
    names = dict.fromkeys((*heads, *samples))
    lines = (line for name in names for line in (*heads.get(name, ()), *samples.get(name, ())))
    return "".join(f"{line}\n" for line in lines)


def _lines(text: str) -> Iterator[tuple[str, str]]:
    """Yield each line with the name of its metric: that of the last `# HELP`."""
    metric = ""
    for line in text.splitlines():
        if line.startswith("# HELP "):
            metric = line.split(" ", 3)[2]
        if line:
            yield metric, line
