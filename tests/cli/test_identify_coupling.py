"""`piezod identify --coupling`, with the couplings of a recording that was made up."""

import json
from pathlib import Path

import pytest

from piezod.cli.identify import coupling_run
from piezod.config.coupling_file import load_coupling
from piezod.experiment.fit.coupling import couplings_in
from tests.cli.conftest import Command
from tests.experiment.fit.test_coupling import made_up


@pytest.mark.parametrize("lag_s", [0.0, 0.02])
def test_the_file_has_what_the_table_shows(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch, lag_s: float
) -> None:
    """Shares and lags, with their uncertainty; a lag is told in words, too."""
    found = couplings_in(made_up(lag_s=lag_s), Path("record.h5"))
    monkeypatch.setattr(coupling_run, "fit_coupling", lambda _: found)
    record = folder / "record.h5"
    record.touch()
    shown = piezod("identify", record, "--coupling", "--out", "coupling.yaml")
    assert shown.code == 0
    assert ("move later" in shown.out) == bool(lag_s)
    stored = load_coupling(folder / "coupling.yaml")
    assert bool(stored.lags_s) == bool(lag_s)
    document = json.loads(piezod("identify", record, "--coupling", "--json").out)
    assert [pair["lag_s"] for pair in document["coupling"]] == [pair.lag_s for pair in found.pairs]
    assert all(pair["lag_uncertainty_s"] > 0.0 for pair in document["coupling"])
