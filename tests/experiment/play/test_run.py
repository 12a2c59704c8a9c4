"""An experiment with `play`: from its file to errors, figures and tables."""

import json
import pickle
from collections.abc import Sequence
from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.devices import registry
from piezod.dynamics.fitting import ResponseFit, fit_response
from piezod.dynamics.measured import MeasuredResponse
from piezod.errors import ConfigError
from piezod_drivers.simulated.driver import SimulatedRig
from tests.cli.conftest import Command, folder, piezod
from tests.experiment.play.rig_axis import CONFIG

__all__ = ["folder", "piezod"]

SHORT = f"""\
title: short
rate_hz: 1000
seed: 1
devices:
  rig:
    driver: simulated
    options:
      variant: stack
      amplifier: {{current_limit_a: 1, slew_v_per_s: 300000, capacitance_uf: 3}}
      sensor: {{antialias_hz: 5000, bandwidth_hz: 10000, delay_s: 0.00011}}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {{drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 250000, rest_v: 0}}
    command_range_um: [0, 28]
    model: {CONFIG}/models/simulated-stack.yaml
    compensator: {{sensor_delay_s: 0.000171}}
settle_s: 0.3
play:
  passes: 3
  settle_s: 0.3
  record_s: 0.2
  waves:
    - name: sine 200 Hz
      command_um: {{kind: sine, low: 4, high: 24, frequency_hz: 200}}
      reference: others
      reference_pct: {{max: 1.5, mean: 0.52}}
"""


FITS: dict[bytes, ResponseFit] = {}


@pytest.fixture(autouse=True)
def fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit a measured response once: all tests measure the same one, and the fit takes half."""

    def known(responses: Sequence[MeasuredResponse]) -> ResponseFit:
        key = pickle.dumps(responses)
        return FITS.get(key) or FITS.setdefault(key, fit_response(responses))

    monkeypatch.setattr("piezod.experiment.play.response.fit_response", known)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures."""
    monkeypatch.setattr("piezod.experiment.play.outputs.save_png", lambda *_: None)


@pytest.fixture
def file(folder: Path) -> Path:
    """Return the path of a short experiment."""
    path = folder / "short.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return path


def test_document_and_files(piezod: Command, file: Path, folder: Path) -> None:
    """The errors fall from play to play; a figure and a table are written."""
    code, out, err = piezod("experiment", file, "--json", "--out", "out")
    assert (code, err) == (0, "")
    document = json.loads(out)
    (wave,) = document["axes"]["x"]["waves"]

    labels = ["inverse model", "inverse and response", "pass 1", "pass 2", "pass 3"]
    assert [play["label"] for play in wave["plays"]] == labels[: len(wave["plays"])]
    worst = [play["true"]["max_pct"] for play in wave["plays"]]
    assert worst[0] > 5.0
    assert 3.0 > worst[1] > worst[-1]
    assert wave["stopped"]
    assert document["axes"]["x"]["response"]["resonances"][0]["frequency_hz"] == pytest.approx(
        807.0, abs=3.0
    )
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "play_x_01.png",
        "table_x_01.yaml",
    ]


def test_failed_waveform_leaves_the_ones_before(piezod: Command, file: Path, folder: Path) -> None:
    """What was learned until then is written; the error names the waveform."""
    failing = "    - {name: late, command_um: {kind: sine, low: 4, high: 24, frequency_hz: 202}}\n"
    file.write_text(SHORT.replace("passes: 3", "passes: 0") + failing, encoding="utf-8")

    code, _, err = piezod("experiment", file, "--out", "out")

    assert code != 0
    assert "late has 99.0099 points per period" in " ".join(err.split())
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "play_x_01.png",
        "table_x_01.yaml",
    ]


@pytest.mark.usefixtures("undrawn")
def test_text_and_a_second_run_that_begins_with_the_stored_table(
    piezod: Command, file: Path
) -> None:
    """Each play has a row; below stand the response, the reason of the stop, and the source.

    With `--tables` the first play is the learned one, and the output says so.
    """
    code, out, err = piezod("experiment", file, "--out", "out")

    assert (code, err) == (0, "")
    for words in (
        "inverse and response",
        "pass 1",
        "published",
        "1.500",
        "Published: others.",
        "the sensor's calibration, 0.",
    ):
        assert words in out
    assert "sine 200 Hz: " in out
    assert "best is pass" in out

    code, out, err = piezod("experiment", file, "--out", "again", "--tables", "out")

    assert (code, err) == (0, "")
    assert "stored table" in out
    assert "begins with table_x_01.yaml" in out
    assert "inverse model" not in out


@pytest.mark.usefixtures("undrawn")
def test_noise_of_the_read_back_at_rest_refuses_no_table(
    piezod: Command, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At rest at 0 V, the lowest voltage, a read-back below 0 V is noise."""
    read_back = SimulatedRig.read_back

    def too_low(rig: SimulatedRig, now_ns: int) -> Sequence[float]:
        return [voltage_v - 0.001 for voltage_v in read_back(rig, now_ns)]

    monkeypatch.setattr(SimulatedRig, "read_back", too_low)
    file.write_text(SHORT.replace("passes: 3", "passes: 0"), encoding="utf-8")

    code, _, err = piezod("experiment", file, "--out", "out")

    assert (code, err) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--live", "--largest-step-pct", "1"), "the loop does not make the steps of a table"),
        (("--tables", "missing"), "does not exist"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    piezod: Command, file: Path, arguments: tuple[str, ...], text: str
) -> None:
    """The exit code is that of a usage error."""
    code, _, err = piezod("experiment", file, *arguments)

    assert code == 2
    assert text in err


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("high: 24", "high: 40", "may exceed the range of axis x"),
        ("  passes: 3\n", "  highest_hz: 10000\n", "allowed: below 10000 Hz, half of the rate"),
        ("  passes: 3\n", "  lowest_hz: 2000\n", "below a tenth of highest_hz"),
        ("frequency_hz: 200", "frequency_hz: 4000", "at most highest_hz, 3000 Hz"),
        (SHORT[SHORT.index("play:") :], "", "at least one case, or `play`"),
    ],
)
def test_mistakes_in_the_file(file: Path, old: str, new: str, text: str) -> None:
    """A mistake is reported with its place before anything moves."""
    assert old in SHORT
    file.write_text(SHORT.replace(old, new), encoding="utf-8")

    with pytest.raises(ConfigError, match=text):
        load_experiment(file, registry)


def test_interval_that_the_device_lacks_is_refused(piezod: Command, file: Path) -> None:
    """An interval that the device does not have ends the run with the next one that it has."""
    text = SHORT.replace("  passes: 3\n", "  passes: 3\n  interval_us: 70\n")
    file.write_text(text, encoding="utf-8")
    code, _, err = piezod("experiment", file, "--out", "out")

    assert code == 1
    assert "the next one that it has is 100 µs" in err


def test_shipped_file_is_valid() -> None:
    """`fast.yaml` has sines from 10 to 200 Hz and a triangle, with 80 % of the travel."""
    config = load_experiment(CONFIG / "experiments" / "fast.yaml", registry)

    assert config.play is not None
    assert [round(1.0 / wave.period_s) for wave in config.play.waves] == [10, 50, 100, 200, 100]
