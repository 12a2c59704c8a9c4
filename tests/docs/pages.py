"""What the blocks of a page find before the first one: files, and a running stage."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from piezod.config.modes import Mode
from piezod.messages import requests
from piezod.records.csv_file import write_csv
from tests.docs.blocks import ROOT, blocks
from tests.experiment.conftest import SHORT
from tests.recorded import RATE_HZ, new_stage, sine, write_recording

SOCKET_FOLDER: Final = "{XDG_RUNTIME_DIR}/piezod/simulated"
RUN: Final = "piezod run config/simulated.yaml"
REMOTE: Final = {
    "https://labpc:": "https://localhost:",
    "DNS:labpc,IP:192.168.1.5": "DNS:localhost,IP:127.0.0.1",
    "labpc.token": "tokens/user",
}
"""The other computer of the documentation is this one."""
SERVE: Final = next(blocks(ROOT / "docs" / "remote.md")).text.replace("DNS:labpc", "DNS:localhost")
"""Makes a certificate, and starts `piezod web` with it."""
GROUPS: Final = ROOT / "docs" / "groups.md"
QUICK: Final = (
    "docs/how-to/read-a-recording.md",
    "docs/monitoring.md",
)
"""Pages that `make test` runs."""
ELSEWHERE: Final = {
    "docs/bluesky.md": "tests/bluesky/test_page.py",
    "docs/writing-a-driver.md": "tests/devices/test_writing_a_driver.py",
}
"""Pages whose blocks form one program, and the test that runs it."""


@dataclass(frozen=True)
class Setting:
    """What the blocks of a page need."""

    #: Commands that run before the first block, such as those of a second terminal.
    before: str = ""
    files: tuple[Callable[[Path], None], ...] = ()  #: Functions that write files into a folder.
    #: Words of the page, and what stands for them.
    words: Mapping[str, str] = field(default_factory=dict)
    #: Whether daemons run beside each other; otherwise a second one ends the first.
    together: bool = False

    def prepare(self, folder: Path) -> None:
        """Write the files."""
        for write in self.files:
            write(folder)


def recording(folder: Path) -> None:
    """Write a recording in three modes, as a daemon makes it, and its samples as CSV."""
    stage = new_stage()
    stage.do(requests.Arm())
    for mode in (Mode.UNCOMPENSATED, Mode.FEEDFORWARD, Mode.ADAPTIVE):
        stage.do(requests.SelectMode(mode=mode), sine(2.0, 22.0, 1.0, 1.9))
        stage.run(2.0)
    write_recording(folder / "scan.h5", stage)
    axes = [record.axes[0] for record in stage.records]
    columns = {
        "t_s": np.arange(len(axes)) / RATE_HZ,
        "drive_v": np.array([axis.in_force_v for axis in axes]),
        "position_um": np.array([axis.position_um for axis in axes]),
    }
    write_csv(folder / "record.csv", columns)


def scope(folder: Path) -> None:
    """Write the file of a scope: monitor of the drive and sensor, both in V."""
    recording(folder)
    table = np.loadtxt(folder / "record.csv", delimiter=",", skiprows=1)
    (folder / "record.csv").unlink()
    rows = (f"{t_s},{drive_v / 20.0},{x_um / 2.0}\n" for t_s, drive_v, x_um in table.tolist())
    head = "Model,MSO44\n\nHorizontal Units,S,\nVertical Units,V,V\n,,\nTIME,CH1,CH2\n"
    (folder / "scope.csv").write_text(head + "".join(rows), encoding="utf-8")


def experiment(folder: Path) -> None:
    """Write an experiment that takes a second."""
    (folder / "my.yaml").write_text(SHORT, encoding="utf-8")


def stage(folder: Path) -> None:
    """Write the configuration of a stage."""
    text = (ROOT / "config" / "simulated.yaml").read_text(encoding="utf-8")
    (folder / "my.yaml").write_text(text.replace("models/", "config/models/"), encoding="utf-8")


def soft_stage(folder: Path) -> None:
    """Write the configuration of a stage whose mode a slower loop finds, on a busy machine too."""
    stage(folder)
    file = folder / "my.yaml"
    text = file.read_text(encoding="utf-8").replace("rate_hz: 200", "rate_hz: 500")
    text = text.replace("{variant: stack}", "{variant: stack, stage: {mode_hz: 120}}")
    file.write_text(text, encoding="utf-8")


def model(folder: Path) -> None:
    """Write a model file."""
    text = (ROOT / "config" / "models" / "simulated-stack.yaml").read_text(encoding="utf-8")
    (folder / "other.yaml").write_text(text, encoding="utf-8")


def trajectory(folder: Path) -> None:
    """Write positions over time."""
    t_s = np.arange(400) / RATE_HZ
    columns = {"t_s": t_s, "position_um": 12.0 - 8.0 * np.cos(6.0 * t_s)}
    write_csv(folder / "scan.csv", columns)


def wave(folder: Path) -> None:
    """Write the waveform of the page about players."""
    text = "command_um: {kind: sine, low: 8, high: 16, frequency_hz: 50}\n"
    (folder / "wave.yaml").write_text(text, encoding="utf-8")


def group(folder: Path) -> None:
    """Write a group and its waveforms, as the page about groups shows them."""
    groups, waves = re.findall(r"```yaml\n(.*?)```", GROUPS.read_text(encoding="utf-8"), re.DOTALL)
    (folder / "piezod").mkdir()
    (folder / "piezod" / "groups.yaml").write_text(groups, encoding="utf-8")
    (folder / "waves.yaml").write_text(waves, encoding="utf-8")


SETTINGS: Final[Mapping[str, Setting]] = {
    "README.md": Setting(files=(recording,), words={"NAME.h5": "scan.h5"}),
    "docs/client.md": Setting(before=RUN, words={"/run/piezod/bench": SOCKET_FOLDER}),
    "docs/commissioning.md": Setting(files=(stage,)),
    "docs/experiments.md": Setting(files=(experiment,)),
    "docs/groups.md": Setting(files=(group,), together=True),
    "docs/how-to/own-record.md": Setting(files=(scope,)),
    "docs/how-to/read-a-recording.md": Setting(files=(recording,)),
    "docs/identify.md": Setting(
        before=RUN, files=(recording,), words={"DATA": "record.csv", "OTHER": "record.csv"}
    ),
    "docs/ioc.md": Setting(before=RUN),
    "docs/monitoring.md": Setting(before=RUN, words={"/run/piezod/stage1": SOCKET_FOLDER}),
    "docs/page.md": Setting(words={"piezod web\n": "piezod web --port 0\n"}),
    "docs/players.md": Setting(before=RUN, files=(wave,)),
    "docs/recordings.md": Setting(
        before=f"{RUN}\npiezod export scan.h5 --out scan.parquet",
        files=(recording, model),
        words={
            "NAME.h5": "scan.h5",
            "NAME.parquet": "scan.parquet",
            "record replay NAME": "record replay scan.h5",
        },
    ),
    "docs/how-to/http.md": Setting(
        before=f"{RUN}\n{SERVE}",
        words={"/run/piezod/simulated": SOCKET_FOLDER, **REMOTE},
    ),
    "docs/remote.md": Setting(before=RUN, words=REMOTE),
    "docs/response.md": Setting(
        files=(soft_stage,),
        words={"piezod response --from NAME.h5": "piezod record get NAME --out m.h5 &&"}
        | {"# evaluates": "piezod response --from m.h5  # evaluates"},
    ),
    "docs/troubleshooting.md": Setting(before=RUN),
    "docs/voltages.md": Setting(files=(recording, trajectory)),
}
"""Pages with other needs than none."""
