"""Amplifiers that lie: `python -m tests.liars`, as `make liars` runs it.

Real daemons drive an amplifier of our own on a pty, which lies in each way, in each state and
during each verb. Prints a table with the largest step, and writes it, and the logs of cases that
broke a bound, to a folder. Exits with 1 if a bound was broken.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.liars.cases import CASES
from tests.liars.config import identified
from tests.liars.lies import LIES
from tests.liars.table import Result, run_lie, summary, table


def main() -> int:
    """Run all cases, print their table, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.liars", description=__doc__)
    parser.add_argument("--lie", action="append", choices=LIES, help="only this one; repeatable")
    parser.add_argument("--case", action="append", choices=CASES, help="only this one; repeatable")
    parser.add_argument("--beside", type=int, default=4, help="daemons at a time")
    parser.add_argument("--out", type=Path, default=Path("build/liars"), help="folder to write")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(chosen.beside) as pool:
        folder = Path(name)
        model = identified(folder)
        cases = chosen.case or list(CASES)
        runs = [
            pool.submit(run_lie, folder / f"{i}", model, lie, cases)
            for i, lie in enumerate(chosen.lie or LIES)
        ]
        results = [result for run in runs for result in run.result()]
    text = f"{table(results)}\n\n{summary(results)}"
    (chosen.out / "table.md").write_text(f"{text}\n", encoding="utf-8")
    (chosen.out / "broken.txt").write_text("".join(map(_broken, results)), encoding="utf-8")
    print(text)
    broken = [result for result in results if result.broken]
    print(f"{len(results)} cases, {len(broken)} with a broken bound: {chosen.out}/broken.txt")
    return 1 if broken else 0


def _broken(result: Result) -> str:
    """Return what broke a bound, with its log; empty if nothing did."""
    if not result.broken:
        return ""
    lines = "\n".join(result.broken)
    return f"=== {result.lie}; {result.case}\n{lines}\nend: {result.end}\n{result.log}\n\n"


if __name__ == "__main__":
    sys.exit(main())
