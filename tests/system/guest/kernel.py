"""Debian's ordinary kernel, prepared to boot with this machine's files as its root."""

import lzma
import os
import shutil
import subprocess
from pathlib import Path
from typing import Final, NamedTuple

_HERE: Final = Path(__file__).parent
_PACKAGE: Final = "linux-image-amd64"
_BOOT: Final = ("virtio_pci", "9pnet_virtio", "9p")
"""Modules that mounting the root needs."""


class Kernel(NamedTuple):
    """A kernel to boot."""

    image: Path  #: The kernel.
    initial: (
        Path  #: Its initial file system: the modules for the root, and a script that mounts it.
    )
    modules: Path  #: Folder of its other modules, for `modprobe --dirname`.
    release: str  #: Its version.


def fetch(cache: Path) -> Kernel:
    """Return Debian's kernel; a package in the cache is not downloaded again.

    Args:
        cache: Folder for the package, 70 MB, and its unpacked files.

    Raises:
        OSError: If the package cannot be downloaded.
    """
    unpacked = cache / "unpacked"
    if not unpacked.is_dir():
        half = cache / "half"
        shutil.rmtree(half, ignore_errors=True)
        _run("dpkg-deb", "--extract", str(_package(cache)), str(half))
        if not (half / "lib").exists():
            (half / "lib").symlink_to("usr/lib")
        for image in (half / "boot").glob("vmlinuz-*"):
            _run("depmod", "--basedir", str(half), image.name.removeprefix("vmlinuz-"))
        half.rename(unpacked)
    (image,) = (unpacked / "boot").glob("vmlinuz-*")
    release = image.name.removeprefix("vmlinuz-")
    initial = cache / "initial"
    _pack(unpacked, release, initial)
    return Kernel(image, initial, unpacked, release)


def _package(cache: Path) -> Path:
    found = sorted(cache.glob("linux-image-*.deb"))
    if not found:
        depends = _run("apt-cache", "depends", _PACKAGE)
        names = [line.split()[-1] for line in depends.splitlines() if "Depends: linux-" in line]
        _run("apt-get", "download", "--quiet=2", *names, cwd=cache)
        found = sorted(cache.glob("linux-image-*.deb"))
    if not found:
        raise OSError(f"apt knows no package {_PACKAGE}")
    return found[-1]


def _pack(unpacked: Path, release: str, initial: Path) -> None:
    """Pack the initial file system into an archive for the kernel."""
    folder = initial.with_suffix(".d")
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("bin", "dev", "modules", "root"):
        (folder / name).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), folder / "bin" / "busybox")
    shutil.copy(_HERE / "init.sh", folder / "init")
    (folder / "init").chmod(0o755)
    order = []
    for path in _needed(unpacked, release):
        data = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
        name = path.name.removesuffix(".xz")
        (folder / "modules" / name).write_bytes(data)
        order.append(name)
    (folder / "modules" / "order").write_text("\n".join(order))
    with initial.open("wb") as archive:
        names = "\n".join(str(path.relative_to(folder)) for path in sorted(folder.rglob("*")))
        subprocess.run(
            ["cpio", "--create", "--format=newc", "--quiet"],  # noqa: S607 - as users have it
            input=names.encode(),
            stdout=archive,
            cwd=folder,
            check=True,
        )


def _needed(unpacked: Path, release: str) -> list[Path]:
    found: dict[Path, None] = {}
    for module in _BOOT:
        shown = _run(
            "modprobe",
            f"--dirname={unpacked}",
            f"--set-version={release}",
            "--show-depends",
            module,
        )
        for line in shown.splitlines():
            if line.startswith("insmod "):
                found[Path(line.split()[1])] = None
    return list(found)


def _run(*command: str, cwd: Path | None = None) -> str:
    ended = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=cwd,
        check=False,
        env={**os.environ, "LC_ALL": "C"},
    )
    if ended.returncode:
        raise OSError(f"{' '.join(command[:2])}: {ended.stderr.strip()}")
    return ended.stdout
