"""`piezod response`: on a daemon in real time, and on a recording."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from piezod.config.response_file import load_response
from piezod.records.csv_file import write_csv
from tests.cli.conftest import Command
from tests.cli.test_live import punctual
from tests.daemon.daemons import Daemon, configuration
from tests.dynamics.made_up import answer, model_of

RATE_HZ = 200.0


@pytest.fixture
def rig(folder: Path) -> Iterator[Daemon]:
    """Return a daemon of a simulated stage."""
    safety = "{safe_v: 0, ramp_v_per_s: 500}"
    with Daemon(configuration(folder, rate_hz=f"{RATE_HZ:g}", safety=safety)) as daemon:
        yield daemon.up()


@pytest.fixture
def recorded(folder: Path) -> Path:
    """Return a recorded random drive of a stage with a mode at 80 Hz, with noise of 3 nm."""
    rng = np.random.default_rng(1)
    drive_v = 75.0 + rng.standard_normal(8_000)
    position_um = 0.1 * answer(model_of(0.0, (80.0, 0.05, 1.0)), drive_v, 1000.0, 1)
    position_um += 0.003 * rng.standard_normal(8_000)
    columns = {"t_s": np.arange(8_000) / 1000.0, "drive_v": drive_v}
    write_csv(folder / "r.csv", {**columns, "position_um": position_um})
    return folder / "r.csv"


def test_running_stage_is_measured(piezod: Command, rig: Daemon, folder: Path) -> None:
    """The stage is driven and left disarmed; the files can be used by its configuration."""
    what = ("response", "x", "--low-hz", "2.5", "--periods", "4", "--out", "r.yaml", "--json")

    code, out, err = punctual(rig, lambda: piezod(*what, "--socket", rig.paths.api_socket))

    assert code == 0, err
    document = json.loads(out)
    assert (document["axis"], document["rate_hz"]) == ("x", RATE_HZ)
    (gain,) = document["gains"]
    assert gain["offset_v"] == 75.0
    assert 0.08 < gain["um_per_v"] < 0.2
    assert document["delay_s"] < 1.5 / RATE_HZ
    assert len(document["lines"]["frequency_hz"]) > 12
    file = load_response(folder / "r.yaml")
    assert (file.method, file.rate_hz, file.delay_s) == ("multisine", 200.0, document["delay_s"])
    assert (folder / "r.csv").read_text().splitlines()[1].split(",")[1] == "2.5"
    assert (folder / "r.png").is_file()
    rig.until("SAFE")


def test_recording_is_evaluated(piezod: Command, recorded: Path) -> None:
    """Without a daemon a recording gives mode and gain, in words."""
    code, out, err = piezod("response", "--from", recorded)

    assert (code, err) == (0, "")
    text = " ".join(out.split())
    assert re.search(r"mode 80\.\d+", text)
    assert "Modes above 500 Hz, half of the rate, are out of reach." in text
    assert "Nothing was written" in text


def test_options_of_the_drive_do_not_go_with_a_recording(piezod: Command, recorded: Path) -> None:
    """Nothing is driven, so that an amplitude is a mistake."""
    code, _, err = piezod("response", "--from", recorded, "--amplitude-v", "2")

    assert code == 2
    assert "nothing is driven" in err
