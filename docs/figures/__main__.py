"""Make all figures of the documentation anew, and its tables beyond the paper: `make figures`.

Runs the experiment of the paper, and those beyond it on all stages, in virtual time; the same code
gives the same numbers. Takes some minutes.
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
from docs.figures.errors import (
    STOPS,
    ErrorsOfModes,
    fast_table,
    short_table,
    variants_table,
    worst_of_cases,
)
from docs.figures.runs import (
    errors_of_variants,
    fast_motion,
    holds,
    of_the_paper,
    on_another_specimen,
    run,
)
from docs.figures.stages import stages_figure
from piezod.config.modes import Mode
from piezod.records.figures import mode_figure, overview_figure, published_figure, save_png
from tests.experiment.beyond import experiment_of

DOCS: Final = Path(__file__).parents[1]
PAGE, README, IMAGES = DOCS / "modes.md", DOCS.parent / "README.md", DOCS / "images"
BEGIN_FAST: Final = "<!-- fast motion, made by `make figures`, begin -->\n"
BEGIN, END = "<!-- made by `make figures`, begin -->\n", "<!-- end -->\n"
SHOWN_CASE: Final = "case 2"


def main() -> None:
    """Run, draw, and write the table into the page."""
    start_s = perf_counter()
    draw_paper()
    save_png(IMAGES / "stages.png", stages_figure())
    errors: dict[str, ErrorsOfModes] = {}
    for variant, surface, stops in errors_of_variants():
        errors[variant] = {STOPS: stops[Mode.FEEDFORWARD], **surface}
        print(f"{perf_counter() - start_s:4.0f} s: {variant}", flush=True)
    stack = run(experiment_of("stack")).recordings
    shown = [each for each in stack if each.case == SHOWN_CASE]
    save_png(IMAGES / "modes-tracking.png", tracking_figure(shown))
    save_png(IMAGES / "modes-stages.png", variants_figure(errors))
    write_table(PAGE, variants_table(errors))
    write_table(PAGE, fast_table(*fast_motion()), BEGIN_FAST)
    write_table(README, short_table(worst_of_cases(stack)))
    save_png(IMAGES / "modes-holding.png", holding_figure(holds()))
    save_png(IMAGES / "modes-exchanged.png", specimen_figure(on_another_specimen()))
    print(f"{perf_counter() - start_s:4.0f} s: done, {PAGE} and {IMAGES} are new")


def draw_paper() -> None:
    """Draw what the README shows of the experiment of the paper."""
    result, reference = of_the_paper()
    save_png(IMAGES / "errors.png", overview_figure(result, reference))
    shown = {each.mode: each for each in result.recordings if each.case == SHOWN_CASE}
    save_png(IMAGES / "uncompensated.png", mode_figure(shown[Mode.UNCOMPENSATED]))
    save_png(IMAGES / "adaptive.png", published_figure(shown[Mode.ADAPTIVE], reference))


def write_table(page: Path, table: str, begin: str = BEGIN) -> None:
    """Put a table between its marks in a page."""
    text = page.read_text(encoding="utf-8")
    before, _, rest = text.partition(begin)
    _, end, after = rest.partition(END)
    if not end:
        raise SystemExit(f"{page} lacks the marks of the table")
    page.write_text(f"{before}{begin}\n{table}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
