"""A folder in which the blocks of one page are run, in their order."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from piezod.client import StageClient
from tests.docs.blocks import ROOT, Block
from tests.docs.command_server import CommandServer, serving

SHIM: Final = ROOT / "tests" / "docs" / "shim.py"
COPIED: Final = ("config", "docs/images", "examples")
"""What a clone has and the blocks use."""
RECORDING: Final = re.compile(r"\bNAME\b")
NEWEST: Final = "$(piezod record list | sed -n '1s/ .*//p')"
"""The name of the newest recording, which a person copies from the output."""


class Workspace:
    """A folder like a clone, with `piezod` and `python` in its path.

    Args:
        folder: The folder.
        server: Runs `piezod`.
        environ: Environment of all commands.
        apart: Whether Python runs in a process of its own.
        words: Words of the page and what stands for them here, as `{"DATA.csv": "record.csv"}`.
    """

    def __init__(
        self,
        folder: Path,
        server: CommandServer,
        environ: dict[str, str],
        words: Mapping[str, str],
        *,
        apart: bool,
    ) -> None:
        self.folder, self._apart = folder, apart
        self._server, self._environ, self._words = server, environ, words

    def run(self, block: Block) -> None:
        """Run a block; raise AssertionError with its output if it fails."""
        self._wait_for_rest()
        if block.language == "sh":
            # At `&&` a shell does not end if the first command fails; at the end of a line it does.
            text = RECORDING.sub(NEWEST, self._prepared(block.text)).replace(" && ", "\n")
            self.shell(text, str(block))
        elif self._apart:
            (self.folder / "block.py").write_text(self._prepared(block.text), encoding="utf-8")
            self.shell("python block.py", str(block))
        else:
            self._python(block)

    def shell(self, commands: str, place: str) -> str:
        """Run commands in a shell that ends at the first failure; return their output."""
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands],  # noqa: S607 - the documented shell
            cwd=self.folder,
            env=self._environ,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        output = done.stdout + done.stderr
        assert done.returncode == 0, f"{place}\n{commands}\n{output}\n{self._server.log}"
        return output

    def _python(self, block: Block) -> None:
        before, changed = Path.cwd(), {**os.environ}
        os.chdir(self.folder)
        os.environ.update(self._environ)
        try:
            code = compile(self._prepared(block.text), str(block), "exec")
            exec(code, {"__name__": "__main__"})  # noqa: S102 - our own page
        except Exception as error:
            raise AssertionError(f"{block}\n{self._server.log}") from error
        finally:
            os.chdir(before)
            os.environ.clear()
            os.environ.update(changed)

    def _prepared(self, text: str) -> str:
        for word, here in self._words.items():
            text = text.replace(word, here.format(**self._environ))
        return text

    def _wait_for_rest(self) -> None:
        """Wait until a stage that a block has stopped is at rest, as a reader does meanwhile."""
        sockets = list(Path(self._environ["XDG_RUNTIME_DIR"]).glob("piezod/*/api.sock"))
        for socket in sockets:
            with StageClient(socket=socket) as stage, closing(stage.telemetry(20.0)) as intervals:
                next(each for each in intervals if each.state != "RAMP")


@contextmanager
def workspace(
    folder: Path,
    prepare: Callable[[Path], None],
    words: Mapping[str, str],
    slower: Mapping[str, str],
    python: str = "",
    *,
    together: bool = False,
) -> Iterator[Workspace]:
    """Make a folder for a page, and end afterwards what its blocks have started.

    Args:
        folder: The folder.
        prepare: Writes the files that the page takes for granted.
        words: Words of the page and what stands for them here.
        slower: Changes to the configurations of daemons, see `CommandServer`.
        python: The interpreter for blocks of Python; "" for this process.
        together: Whether daemons run beside each other.
    """
    for each in COPIED:
        shutil.copytree(ROOT / each, folder / each)
    prepare(folder)
    short = Path(tempfile.mkdtemp(prefix="pz-"))  # the path of a socket must be short
    bin = folder / ".venv" / "bin"
    bin.mkdir(parents=True)
    shim = f"#!{sys.executable} -IS\n{SHIM.read_text(encoding='utf-8')}"  # -IS: starts at once
    scripts = {
        "activate": "",
        "piezod": shim,
        "python": f'#!/bin/sh\nexec {python or sys.executable} "$@"\n',
    }
    for name, text in scripts.items():
        (bin / name).write_text(text, encoding="utf-8")
        (bin / name).chmod(0o755)
    environ = {
        **os.environ,
        "PATH": f"{bin}:{os.environ['PATH']}",
        "XDG_RUNTIME_DIR": str(short),
        "XDG_STATE_HOME": str(short),
        "XDG_CONFIG_HOME": str(folder),
        "PIEZOD_TEST_COMMANDS": str(short / "commands"),
        "MPLBACKEND": "Agg",
    }
    try:
        with serving(short, environ, slower, together=together) as server:
            yield Workspace(folder, server, environ, words, apart=bool(python))
    finally:
        shutil.rmtree(short)
