"""Runs cases, and makes their table."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from tests.liars.bench import Bench
from tests.liars.cases import CASES
from tests.liars.judge import (
    PERIOD_S,
    Step,
    fast_points,
    is_visible,
    largest_by_itself_v,
    steps_of,
)

HEADING: Final = (
    "lie",
    "state or verb",
    "largest step by piezod (V)",
    "allowed (V)",
    "no witness (V)",
    "largest step of the amplifier by itself (V)",
    "told",
    "end",
)
SUMMARY: Final = (
    "lie",
    "largest step by piezod within its bound (V)",
    "beyond it (cases)",
    "beyond it without a witness (cases)",
    "the largest of these (V)",
    "largest step of the amplifier by itself (V)",
)

TRIES: Final = 4


class Result(NamedTuple):
    """The result of a case."""

    lie: str  #: Its lie.
    case: str  #: Its state or verb.
    #: The write that was farthest from the voltage on the stage, of those within their bound, or
    #: with a witness; None if nothing was written.
    worst: Step | None
    #: Largest distance of a write beyond its bound that no witness could tell, in V; 0 if there was
    #: none.
    unseen_v: float
    itself_v: float  #: Largest step of the amplifier by itself, in V.
    told: Sequence[str]  #: What the daemon has told while the lie lasted.
    end: str  #: Where it ended.
    broken: Sequence[str]  #: The bounds that were broken.
    log: str  #: The log of the daemon meanwhile.

    def cells(self) -> Sequence[str]:
        """Return its line of the table."""
        step_v = f"{self.worst.distance_v:.2f}" if self.worst else "none"
        allowed_v = f"{self.worst.allowed_v:.2f}" if self.worst else ""
        unseen_v, itself_v = f"{self.unseen_v:.2f}" if self.unseen_v else "", f"{self.itself_v:.2f}"
        told = " ".join(self.told) or "nothing"
        return self.lie, self.case, step_v, allowed_v, unseen_v, itself_v, told, self.end


def run_case(bench: Bench, lie: str, case: str) -> Result:
    """Let an amplifier lie in a state or during a verb; return what became of it."""
    chosen = CASES[case]
    _prepare(bench, chosen.prepare)
    thread_ms = bench.reckons_with_ms() if bench.runs else 0.0
    bench.told.clear()
    bench.take_log()
    first = len(bench.amplifier.rows())
    bench.amplifier.tell(f"lie {lie}")
    end_s = time.monotonic() + chosen.lasts_s
    chosen.act(bench)
    bench.rest(max(0.0, end_s - time.monotonic()))
    told, ran = sorted(bench.told), bench.drives
    lied = len(bench.amplifier.rows())
    bench.amplifier.tell("honest")
    end = bench.home()
    rows = bench.amplifier.rows()
    judged = steps_of(rows, PERIOD_S / 2 if thread_ms else 0.0)
    steps = [step for step in judged if step.t_s > rows[first].t_s]
    unseen_v = max((each.distance_v for each in steps if _is_unseen(each)), default=0.0)
    steps = [step for step in steps if not _is_unseen(step)]
    later = [row for row in rows[lied:] if row.kind == "write"]  # it was driven until then
    untold = ran and not told and is_visible([*rows[first:lied], *later])
    worst = max(steps, key=lambda step: (step.is_far, step.distance_v), default=None)
    broken = [
        *_far(steps, thread_ms),
        *fast_points(rows[first:])[:5],
        *(["not told"] if untold else []),
        *([end] if "NOT HOME" in end else []),
    ]
    itself_v = largest_by_itself_v(rows[first:])
    return Result(lie, case, worst, unseen_v, itself_v, told, end, broken, bench.take_log())


def _is_unseen(step: Step) -> bool:
    """Return whether a write was too far, and nothing could tell that."""
    return step.is_far and not step.has_witness


def _prepare(bench: Bench, prepare: Callable[[Bench], None]) -> None:
    """Bring an honest stage to where the lie begins; again, if late cycles have held it."""
    for left in reversed(range(TRIES)):
        bench.at_rest()
        try:
            prepare(bench)
        except AssertionError:
            if not left:
                raise
            bench.home()
        else:
            return


def _far(steps: Sequence[Step], thread_ms: float) -> list[str]:
    """Return the writes that were too far, of several in a row the first, and their number."""
    found, count = list[str](), 0
    for before, step in zip([None, *steps], steps, strict=False):
        count += step.is_far
        if step.is_far and not (before and before.is_far):
            found.append(str(step))
    return [*found[:5], f"{count} writes too far; {_placed(thread_ms)}"] if found else []


def run_lie(folder: Path, model: Path, lie: str, cases: Sequence[str]) -> list[Result]:
    """Run cases of a lie with an amplifier; a case that fails, or needs another, has a new one."""
    results, left = list[Result](), list(cases)
    while left:
        speaks = CASES[left[0]].speaks
        with Bench(folder / f"{len(left)}", model, speaks) as bench:
            while left and CASES[left[0]].speaks == speaks:
                case = left.pop(0)
                try:
                    results.append(run_case(bench, lie, case))
                except Exception as error:  # noqa: BLE001 - the other cases are to run
                    what = f"the case failed: {type(error).__name__}: {error}"
                    log = bench.take_log()
                    results.append(Result(lie, case, None, 0.0, 0.0, (), "", (what,), log))
                print(" | ".join(results[-1].cells()), *results[-1].broken, sep="\n   ", flush=True)
                if not results[-1].end.startswith("SAFE"):
                    break
    return results


def table(results: Sequence[Result]) -> str:
    """Return the table, in Markdown."""
    return _markdown(HEADING, [each.cells() for each in results])


def summary(results: Sequence[Result]) -> str:
    """Return a table with a line for each lie, in Markdown."""
    return _markdown(SUMMARY, [_sum(lie, results) for lie in dict.fromkeys(r.lie for r in results)])


def _sum(lie: str, results: Sequence[Result]) -> Sequence[str]:
    """Return the line of a lie in the summary."""
    those = [each for each in results if each.lie == lie]
    steps = [each.worst for each in those if each.worst]
    within_v = max((step.distance_v for step in steps if not step.is_far), default=0.0)
    n_far, n_unseen = sum(step.is_far for step in steps), sum(each.unseen_v > 0 for each in those)
    unseen_v, itself_v = (
        f"{max(getattr(each, name) for each in those):.2f}" for name in ("unseen_v", "itself_v")
    )
    of = f"of {len(those)}"
    return lie, f"{within_v:.2f}", f"{n_far} {of}", f"{n_unseen} {of}", unseen_v, itself_v


def _markdown(heading: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    lines = [heading, ("---",) * len(heading), *lines]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _placed(thread_ms: float) -> str:
    """Return how the loop uses the amplifier, for people."""
    return f"a thread with round trips of {thread_ms:.1f} ms" if thread_ms else "in the cycle"
