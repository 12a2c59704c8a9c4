"""Make all figures of the documentation anew, and its tables of errors: `make figures`.

Runs the experiment of the paper, and those beyond it on all stages, in virtual time; the same code
gives the same numbers. Takes some minutes.
"""

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
    fast_rows,
    short_rows,
    variants_rows,
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
from docs.measured.__main__ import main as write_appendix
from docs.measured.tables import PAGE, save
from piezod.config.modes import Mode
from piezod.records.figures import mode_figure, overview_figure, published_figure, save_png
from tests.experiment.beyond import experiment_of

IMAGES: Final = PAGE.parent / "images"
SHOWN_CASE: Final = "case 2"


def main() -> None:
    """Run, draw, store the tables, and write the appendix with them."""
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
    save("errors-of-modes", variants_rows(errors))
    save("fast-motion", fast_rows(*fast_motion()))
    save("beyond", short_rows(worst_of_cases(stack)))
    save_png(IMAGES / "modes-holding.png", holding_figure(holds()))
    save_png(IMAGES / "modes-exchanged.png", specimen_figure(on_another_specimen()))
    write_appendix()
    print(f"{perf_counter() - start_s:4.0f} s: done, {PAGE} and {IMAGES} are new")


def draw_paper() -> None:
    """Draw what the README shows of the experiment of the paper."""
    result, reference = of_the_paper()
    save_png(IMAGES / "errors.png", overview_figure(result, reference))
    shown = {each.mode: each for each in result.recordings if each.case == SHOWN_CASE}
    save_png(IMAGES / "uncompensated.png", mode_figure(shown[Mode.UNCOMPENSATED]))
    save_png(IMAGES / "adaptive.png", published_figure(shown[Mode.ADAPTIVE], reference))


if __name__ == "__main__":
    main()
