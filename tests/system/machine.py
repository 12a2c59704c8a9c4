"""A machine with a real systemd: an overlay of this machine's files, booted in a container.

Its writes go to memory and are lost at the end. piezod is installed from its wheel, in /opt/piezod.
Interpreter and libraries are those of the test, mounted at other places, because services cannot
see the homes of users.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path
from typing import Final, Self

from tests.daemon.waiting import eventually

REPOSITORY: Final = Path(__file__).parents[2]
PIEZOD: Final = "/opt/piezod/bin/piezod"
_PYTHON: Final = f"python{sys.version_info.major}.{sys.version_info.minor}"
_NEEDED: Final = ("systemd-nspawn", "nsenter", "setpriv", "ldconfig", "mount")


def why_not() -> str:
    """Return why no machine can be booted here, or ""."""
    if os.geteuid() != 0:
        return "only root can boot a container"
    missing = [name for name in _NEEDED if shutil.which(name) is None]
    if missing:
        return f"not installed: {', '.join(missing)}"
    return "" if Path("/lib/systemd/systemd").exists() else "systemd is not installed"


class Machine:
    """The machine, running while its context is entered."""

    def __init__(self, wheel: Path, log: Path) -> None:
        self._name = f"pz-machine-{os.getpid()}"
        self._folder = Path(tempfile.mkdtemp(prefix="pz-machine-"))
        self._root = self._folder / "root"
        self._wheel, self._log = wheel, log
        self._process: subprocess.Popen[bytes] | None = None
        self._leader = 0

    def __enter__(self) -> Self:
        """Boot it."""
        try:
            self._mount()
            self._install()
            self._boot()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Switch it off, and remove its files."""
        self._end()

    def run(self, command: str, user: str = "root") -> "subprocess.CompletedProcess[str]":
        """Run a shell command in it, with the groups and the environment of a login."""
        login = ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", "--reset-env"]
        inside = ["nsenter", "--all", f"--target={self._leader}", "--", *login]
        return subprocess.run(
            [*inside, "sh", "-c", command],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def root(self, command: str) -> str:
        """Run a shell command as root; return its output."""
        ended = self.run(command)
        assert ended.returncode == 0, (command, ended.stdout, ended.stderr)
        return ended.stdout.strip()

    def wait_until(self, condition: str, within_s: int = 60) -> None:
        """Wait until a shell command succeeds; the loop runs in the machine, which costs less."""
        self.root(f"timeout {within_s} sh -c 'until {condition}; do sleep 0.1; done'")

    def write(self, path: str, text: str) -> None:
        """Write a file that every user may read, also before the boot."""
        file = self._root / path.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        file.chmod(0o644)

    def _mount(self) -> None:
        layers = self._folder / "layers"
        layers.mkdir()
        self._root.mkdir()
        _run("mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", str(layers))
        upper, work = layers / "upper", layers / "work"
        upper.mkdir()
        work.mkdir()
        options = f"lowerdir=/,upperdir={upper},workdir={work}"
        _run("mount", "-t", "overlay", "-o", options, "overlay", str(self._root))

    def _install(self) -> None:
        venv = self._root / "opt" / "piezod"
        packages = venv / "lib" / _PYTHON / "site-packages"
        packages.mkdir(parents=True)
        (packages / "dependencies.pth").write_text("/opt/dependencies\n")
        with zipfile.ZipFile(self._wheel) as wheel:
            wheel.extractall(packages)
        (venv / "bin").mkdir()
        (venv / "bin" / "python").symlink_to(f"/opt/python/bin/{_PYTHON}")
        self.write("/opt/piezod/pyvenv.cfg", "home = /opt/python/bin\n")
        script = "from piezod.cli.main import run\n\nrun()\n"
        self.write(PIEZOD, f"#!/opt/piezod/bin/python\n{script}")
        (venv / "bin" / "piezod").chmod(0o755)
        for path in ("/opt/python", "/opt/dependencies"):
            (self._root / path[1:]).mkdir()
        # Without an entry in the cache, a shared libpython is searched where it was built.
        self.write("/etc/ld.so.conf.d/00-python.conf", "/opt/python/lib\n")
        self.write("/etc/machine-id", "")
        self.write("/etc/environment", "")

    def _boot(self) -> None:
        command = ["systemd-nspawn", "--quiet", "--boot", f"--directory={self._root}"]
        # Do not register: the first process of the test's machine may be no systemd.
        command += [f"--machine={self._name}", "--keep-unit", "--register=no"]
        command += ["--private-network", "--link-journal=no"]
        command += ["--resolv-conf=off", "--timezone=off", "--console=pipe"]
        command += ["--capability=CAP_IPC_LOCK,CAP_SYS_NICE"]
        command += [f"--bind-ro={sys.base_prefix}:/opt/python"]
        command += [f"--bind-ro={sysconfig.get_path('purelib')}:/opt/dependencies"]
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [*command, "systemd.unit=basic.target"],
                env={**os.environ, "SYSTEMD_NSPAWN_UNIFIED_HIERARCHY": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        eventually(self._is_up)
        self.root("ldconfig")

    def _is_up(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, self._log.read_text(errors="replace")
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        pids = children.read_text(encoding="ascii").split()
        if not pids:
            return False
        self._leader = int(pids[-1])
        return self.run("systemctl is-active basic.target").stdout.strip() == "active"

    def _end(self) -> None:
        if self._process is not None:
            self._process.terminate()  # nspawn then switches the machine off
            try:
                self._process.wait(20)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for mount in (self._root, self._folder / "layers"):
            if mount.is_mount():
                _run("umount", "--lazy", str(mount))
        shutil.rmtree(self._folder)
        # nspawn leaves this folder behind if /run is no tmpfs.
        shutil.rmtree(Path("/run/systemd/nspawn/propagate", self._name), ignore_errors=True)


def build_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout into a folder; return its path."""
    _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder))
    (wheel,) = folder.glob("*.whl")
    return wheel


def _run(*command: str) -> None:
    subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True)
