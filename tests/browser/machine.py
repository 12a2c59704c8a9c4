"""A machine with stages and a page: processes of the checkout, in folders of their own."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from shutil import copytree
from typing import Final

from tests.daemon.waiting import eventually

ROOT: Final = Path(__file__).parents[2]
SIMULATED: Final = "simulated"
EMULATED: Final = "emulated"
"""The stages of this machine: the simulated one, and one with an emulated device on a bus."""
STARTED_WITHIN_S: Final = 60.0
"""The first start after an installation compiles the kernels."""
ENDED_WITHIN_S: Final = 20.0


class Machine:
    """Processes of piezod that see nothing of the rest of this computer.

    In a folder with a short path, because it will contain sockets.
    """

    stage: "subprocess.Popen[str]"
    web: "subprocess.Popen[str]"

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.config = folder / "config"
        copytree(ROOT / "config", self.config)
        self._started: list[subprocess.Popen[str]] = []
        runtime, state = folder / "run", folder / "state"
        runtime.mkdir()
        variables = {name: text for name, text in os.environ.items() if "PIEZOD" not in name}
        self._environ: Mapping[str, str] = {
            **variables,
            "XDG_RUNTIME_DIR": str(runtime),
            "XDG_STATE_HOME": str(state),
            "XDG_CACHE_HOME": str(folder / "cache"),
            "TMPDIR": str(folder),
            "PYTHONUNBUFFERED": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }

    def start(self, *arguments: str) -> "subprocess.Popen[str]":
        """Start `piezod` with some arguments."""
        with (self.folder / f"{arguments[0]}.log").open("a") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "piezod", *arguments],
                env=self._environ,
                cwd=self.folder,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        self._started.append(process)
        return process

    def start_stage(self, config: str = "simulated.yaml") -> "subprocess.Popen[str]":
        """Start the daemon of a stage; return when it accepts requests."""
        log = self.folder / "run.log"
        begin = log.stat().st_size if log.exists() else 0
        self.stage = process = self.start("run", str(self.config / config))

        def ready() -> bool:
            text = log.read_text()[begin:]
            assert process.poll() is None, text
            return " ready " in text

        eventually(ready, STARTED_WITHIN_S)
        return process

    def start_emulated_stage(self) -> None:
        """Start an emulated LabJack T7 on Modbus TCP, and the daemon of its stage."""
        place = self.line_of(self.start("emulate", "labjack-t7", "--port", "127.0.0.1:0"))
        port = re.findall(r":(\d+)", place)[-1]
        config = self.config / "devices" / "labjack-t7.yaml"
        text = config.read_text().replace("192.168.1.207", "127.0.0.1")
        text = text.replace("tcp_port: 502", f"tcp_port: {port}")
        # A machine that also runs a browser answers late.
        text = text.replace("rate_hz: 500", "rate_hz: 50")
        config.write_text(text.replace("timeout_ms: 20", "timeout_ms: 200"))
        self.start_stage("devices/labjack-t7.yaml")

    def start_web(self, *options: str) -> str:
        """Start the server of the page; return its address with the token."""
        self.web = self.start("web", "--port", "0", *options)
        return self.line_of(self.web)

    def line_of(self, process: "subprocess.Popen[str]") -> str:
        """Return the next line that a process prints."""
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        assert line, f"{process.args!r} has ended"
        return line

    def run(self, *arguments: str) -> str:
        """Run `piezod` to its end; return what it prints."""
        process = self.start(*arguments)
        out, _ = process.communicate(timeout=ENDED_WITHIN_S)
        assert process.returncode == 0, (self.folder / f"{arguments[0]}.log").read_text()
        return out

    def stop(self) -> None:
        """End all processes, the newest first: a daemon before the emulator of its device."""
        for process in reversed(self._started):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(ENDED_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
