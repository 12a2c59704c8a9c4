"""How an identification is told: text for people, a document for programs."""

from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from piezod.experiment.delay import DelayEstimate
from piezod.experiment.identify_file import FileFit
from piezod.hysteresis.memory import FloatArray
from piezod.records.labels import metric_label, metric_number

_BARS = "▁▂▃▄▅▆▇█"


def as_document(fitted: FileFit, model: Path | None, plot: Path | None) -> dict[str, object]:
    """Return the document of `piezod identify --json`.

    Args:
        fitted: The model and how good it is.
        model: Path of the model file, None where none was written.
        plot: Path of the figure, None where none was drawn.
    """
    fit = fitted.fit
    return {
        "data": str(fitted.data),
        "samples": fitted.record.t_s.size,
        "rate_hz": 1.0 / fitted.record.period_s,
        "method": fit.settings.method,
        "order": fit.model.weights.size // 2,
        "delay_s": fit.model.delay_s,
        "delay_estimate": _delay_document(fit.delay) if fit.delay else None,
        "train": fitted.train,
        "test": fitted.test,
        "smallest_slope": fit.smallest_slope,
        "warnings": fitted.warnings,
        "model": str(model) if model else None,
        "plot": str(plot) if plot else None,
    }


def _delay_document(delay: DelayEstimate) -> dict[str, object]:
    return {
        "delay_s": delay.delay_s,
        "uncertainty_s": delay.uncertainty_s,
        "one_frequency": delay.one_frequency,
        "criterion": {
            "delay_s": delay.candidates_s.tolist(),
            "voltage_error_rms_pct": delay.criterion_pct.tolist(),
        },
    }


def print_fit(console: Console, fitted: FileFit, model: Path | None, plot: Path | None) -> None:
    """Print the delay, the errors, what to beware of, and what was written.

    Args:
        console: Where to.
        fitted: The model and how good it is.
        model: Path of the model file, None where none was written.
        plot: Path of the figure, None where none was drawn.
    """
    fit, record = fitted.fit, fitted.record
    length_s = record.t_s[-1] - record.t_s[0]
    console.print(
        f"{fitted.data}: {_count(record.t_s.size, 'sample')} at {1.0 / record.period_s:.6g} Hz, "
        f"{length_s:.4g} s",
        soft_wrap=True,
    )
    _print_delay(console, fit.model.delay_s, fit.delay)
    console.print(
        f"Model by {fit.settings.method}, {_count(fit.model.weights.size // 2, 'operator')} on each side. "
        "How well it predicts the drive voltage, in % of its range:"
    )
    console.print(_errors(fitted))
    for warning in fitted.warnings:
        console.print(f"! {warning}", style="yellow")
    if model and plot:
        console.print(f"Model: {model}\nFigure: {plot}", soft_wrap=True)
    else:
        console.print("Nothing was written; --out model.yaml keeps the model and draws it.")


def _count(number: int, one: str) -> str:
    return f"{number} {one}" if number == 1 else f"{number} {one}s"


def _print_delay(console: Console, delay_s: float, delay: DelayEstimate | None) -> None:
    if delay is None:
        console.print(f"Delay {_ms(delay_s)}, as given.")
        return
    first, last = _ms(delay.candidates_s[0]), _ms(delay.candidates_s[-1])
    low, high = delay.criterion_pct.min(), delay.criterion_pct.max()
    best = int(delay.criterion_pct.argmin())
    console.print(
        f"Delay {_ms(delay_s)} ± {_ms(delay.uncertainty_s)}, where the rms error of the predicted "
        "voltage is least:\n"
    )
    margin = " " * (len(first) + 3)
    console.print(f"  {first} {_curve(delay.criterion_pct)} {last}")
    console.print(f"{margin}{' ' * best}▲ {low:.3g} %, the worst is {high:.3g} %\n")


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.3g} ms"


def _curve(values: FloatArray) -> str:
    """Return values as a row of bars, as high as they are above the least."""
    above = (values - values.min()) / max(float(values.max() - values.min()), 1e-300)
    return "".join(_BARS[round(share * (len(_BARS) - 1))] for share in above)


def _errors(fitted: FileFit) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("")
    table.add_column("file", overflow="fold")
    for name in fitted.train:
        table.add_column(metric_label(name), justify="right")
    rows = [("train", fitted.data, fitted.train)]
    if fitted.test_data and fitted.test:
        rows.append(("test", fitted.test_data, fitted.test))
    for role, path, errors in rows:
        numbers = [f"{metric_number(*error)} %" for error in errors.items()]
        table.add_row(role, Text(path.name), *numbers)
    return table
