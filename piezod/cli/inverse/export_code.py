"""`piezod export-code`: the inverse of a model as C or MATLAB."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.inverse.voltages import ConfigOption, ModelArgument, OfAxisOption
from piezod.cli.options import JsonOption
from piezod.cli.output import print_one
from piezod.cli.record.recordings import checked_out


class Language(StrEnum):
    """Languages of exported code."""

    C = "c"
    MATLAB = "matlab"


def export_code(
    model: ModelArgument,
    to: Annotated[Language, typer.Option("--to", help="Language: C99, or MATLAB and Octave.")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="File to write, .c or .m; its name becomes that of the functions. Default: the "
            "name of MODEL, in the current folder.",
        ),
    ] = None,
    loop_hz: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            min=0.01,
            max=1e6,
            help="Rate at which the code will be called. Default: that of the identification.",
            show_default=False,
        ),
    ] = None,
    config: ConfigOption = None,
    axis: OfAxisOption = None,
    json: JsonOption = False,
) -> None:
    """Write the inverse of a model as one file of C or MATLAB, with a self-test.

    The code computes the voltages of `piezod voltages`, without limits of the slew rate and without
    shaping for modes. C needs no library: `cc -DSELF_TEST FILE.c && ./a.out` tests it.
    """
    ending = ".c" if to is Language.C else ".m"
    stem = model.stem.replace("-", "_")
    path = checked_out(out, Path(f"{stem}{ending}"), (ending,))
    # numba takes long to import.
    from piezod.cli.inverse.voltages_run import axis_of
    from piezod.inverse.exported_code import exported_code
    from piezod.inverse.loaded_model import load_model
    from piezod.records.atomic import replacing

    loaded = load_model(model, rate_hz=loop_hz, axis=axis_of(config, axis))
    text = exported_code(loaded, to.value, path)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    test = f"cc -DSELF_TEST {path} && ./a.out" if to is Language.C else f"{path.stem}('self-test')"
    lookahead_s = loaded.lookahead_s(loaded.rate_hz)
    found = {"model": str(model), "file": str(path), "rate_hz": loaded.rate_hz}
    what = (
        f"{path}: call it at {loaded.rate_hz:.6g} Hz with the position of {1e3 * lookahead_s:.3g} "
        f"ms later; self-test: {test}"
    )
    print_one({**found, "lookahead_s": lookahead_s}, what, json=json)
