"""What the guest sends to the host, line by line, and what is printed of it."""

import json
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple


class Result(NamedTuple):
    """Result of a check."""

    name: str  #: The fact that was checked.
    reason: str  #: Why it failed; empty if it passed.
    detail: str  #: What was seen.
    duration_s: float  #: How long it took.

    def __str__(self) -> str:
        """Return the line for people."""
        seen = self.reason or self.detail
        verdict = "failed" if self.reason else "ok"
        return f"{verdict:6} {self.duration_s:6.1f} s  {self.name}{': ' if seen else ''}{seen}"


def serve(
    lines: Iterable[str], answer: Callable[[str], None], do: Mapping[str, Callable[[str], str]]
) -> list[Result]:
    """Print the results that a guest sends, and carry out its requests, until it has ended.

    Args:
        lines: What it sends.
        answer: Sends it a line.
        do: What it may ask for; each takes the argument of the request and returns the answer.

    Returns:
        The results; one that failed at the end if the guest did not say that all checks were made.
    """
    results: list[Result] = []
    why = "it ended before its last check"
    try:
        for line in lines:
            document: dict[str, Any] = json.loads(line)
            if "request" in document:
                answer(do[document["request"]](document["argument"]))
            elif "name" in document:
                results.append(Result(**document))
                print(results[-1], flush=True)
            else:
                return results
    except TimeoutError:
        why = "it hangs"
    results.append(Result("the guest makes all checks", why, "", 0.0))
    print(results[-1], flush=True)
    return results


def verdict(results: list[Result]) -> tuple[str, int]:
    """Return the last line for people, and the exit code."""
    failed = sum(bool(result.reason) for result in results)
    text = f"{len(results) - failed} ok, {failed} failed"
    return text, 1 if failed or not results else 0
