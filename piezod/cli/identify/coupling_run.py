"""The work of `piezod identify --coupling`."""

from datetime import UTC, datetime
from pathlib import Path

from piezod.cli.output import new_console, new_table, print_json
from piezod.config.coupling_file import dump_coupling
from piezod.experiment.fit.coupling import CoupledPair, fit_coupling
from piezod.records.atomic import replacing


def fit_couplings(data: Path, out: Path | None, *, json: bool) -> None:
    """Fit the couplings of a recording, write them if there is a path, and print them."""
    found = fit_coupling(data)
    if out is not None:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with replacing(out) as part:
            part.write_text(dump_coupling(found.file(now)), encoding="utf-8")
    if json:
        pairs = [pair._asdict() for pair in found.pairs]
        print_json({"coupling": pairs, "file": None if out is None else str(out)})
        return
    table = new_table(
        "axis", "moves", right=("by/%", "±/%", "error/µm", "left/µm", "later/ms", "±/ms")
    )
    for pair in found.pairs:
        table.add_row(pair.moving, pair.resting, *_numbers(pair))
    console = new_console()
    console.print(table)
    if any(pair.lag_s for pair in found.pairs):
        console.print(
            "Some axes move later than those that move them: the transform corrects that in moves "
            "and waves, not in streams of setpoints.",
            soft_wrap=True,
        )
    if out is not None:
        console.print(f"written: {out}, for `coupling:` of a transform", soft_wrap=True)


def _numbers(pair: CoupledPair) -> list[str]:
    lag = f"{1e3 * pair.lag_s:.2f}" if pair.lag_s else "–"
    percent = (f"{100 * pair.share:.3f}", f"{100 * pair.uncertainty:.3f}")
    uncertain = f"{1e3 * pair.lag_uncertainty_s:.2f}"
    return [*percent, f"{pair.before_um:.3f}", f"{pair.after_um:.3f}", lag, uncertain]
