"""Make the figures and the table of `docs/modes.md` anew: `make figures`.

Runs the experiments beyond the paper on all stages, in virtual time; the same code gives the same
numbers. Takes some minutes.
"""

from pathlib import Path
from time import perf_counter
from typing import Final

from docs.figures.drawings import (
    holding_figure,
    specimen_figure,
    tracking_figure,
    variants_figure,
)
from docs.figures.errors import markdown_table, worst_of_cases
from docs.figures.runs import FILES, holds, load, on_another_specimen, run
from piezod.records.figures import save_png

DOCS: Final = Path(__file__).parents[1]
PAGE, IMAGES = DOCS / "modes.md", DOCS / "images"
BEGIN, END = "<!-- made by `make figures`, begin -->\n", "<!-- end -->\n"
SHOWN_CASE: Final = "case 2"


def main() -> None:
    """Run, draw, and write the table into the page."""
    start_s = perf_counter()
    recordings = {}
    for stage in FILES:
        recordings[stage] = run(load(stage))
        print(f"{perf_counter() - start_s:4.0f} s: {stage}")
    errors = {stage: worst_of_cases(runs) for stage, runs in recordings.items()}
    shown = [each for each in recordings["stack"] if each.case == SHOWN_CASE]
    save_png(IMAGES / "modes-tracking.png", tracking_figure(shown))
    save_png(IMAGES / "modes-stages.png", variants_figure(errors))
    write_table(markdown_table(errors))
    save_png(IMAGES / "modes-holding.png", holding_figure(holds()))
    save_png(IMAGES / "modes-exchanged.png", specimen_figure(on_another_specimen()))
    print(f"{perf_counter() - start_s:4.0f} s: done, {PAGE} and {IMAGES}/modes-*.png are new")


def write_table(table: str) -> None:
    """Put the table between its marks in the page."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise SystemExit(f"{PAGE} lacks the marks of the table")
    PAGE.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
