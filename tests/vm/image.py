"""The disk of the virtual machine: Debian 12 with systemd, and the libraries that piezod needs.

What takes long is kept in the cache: the packages of Debian, the wheels, the finished disk. Each is
made anew when what it is made from has changed.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final, NamedTuple

from tests.vm.wheels import Wheels

SUITE: Final = "bookworm"
PORT: Final = "piezod.vm"
"""Name of the port to the host."""
PACKAGES: Final = (
    "systemd,systemd-sysv,dbus,udev,libnss-systemd,kmod,iproute2,procps,python3,python3-venv,"
    "linux-image-amd64,initramfs-tools,libcomedi0"
)
"""What the guest is made of; the ordinary kernel, because Debian's cloud kernel has no CAN."""
NEEDED: Final = {
    "mmdebstrap": "mmdebstrap",
    "qemu-system-x86_64": "qemu-system-x86",
    "qemu-img": "qemu-utils",
    "mkfs.ext4": "e2fsprogs",
}
"""Package of each command that this machine needs."""
_LEFT_OUT: Final = (
    *("/usr/share/doc/*", "/usr/share/locale/*", "/usr/share/man/*"),
    *(f"*/kernel/{name}/*" for name in ("sound", "drivers/gpu", "drivers/media")),
    *(f"*/kernel/drivers/net/{name}/*" for name in ("ethernet", "wireless")),
)
_INITIAL: Final = {
    "etc/initramfs-tools/conf.d/vm": "MODULES=list\nCOMPRESS=gzip\n",
    "usr/share/initramfs-tools/modules.d/vm": "virtio_pci\nvirtio_blk\next4\n",
}
KERNELS: Final = "NUMBA_CPU_NAME=generic"
"""Kernels that each processor can run, so that those of the host are used in the guest."""
_HERE: Final = Path(__file__).parent


class Image(NamedTuple):
    """What boots."""

    disk: Path  #: File system of the guest; it is not written to.
    kernel: Path  #: Kernel.
    initial: Path  #: Initial file system, with the modules that mounting the disk needs.
    root: Path  #: The files of the disk, in a folder.


def missing() -> list[str]:
    """Return what this machine lacks, one line each with the remedy."""
    lacking = [package for command, package in NEEDED.items() if shutil.which(command) is None]
    reasons = [f"not installed: sudo apt install {' '.join(lacking)}"] if lacking else []
    if os.geteuid() != 0:
        reasons.append("only root can unpack a system with its owners: run it with sudo")
    return reasons


def build(cache: Path, wheels: Wheels) -> Image:
    """Return the image for these wheels; what is in the cache is not made again.

    Raises:
        subprocess.CalledProcessError: If a package cannot be downloaded or installed.
    """
    debian = _debian(cache)
    found = cache / f"image-{_digest(debian.name, *wheels.names, *_guest_files().values())}"
    if not found.is_dir():
        _say(f"making the disk {found.name}")
        half = cache / "half"
        shutil.rmtree(half, ignore_errors=True)
        half.mkdir()
        root = half / "root"
        _unpack(debian, root)
        _install_libraries(root, wheels.folder)
        for name in ("vmlinuz", "initrd.img"):
            shutil.copy((root / name).resolve(), half / name)
        size = ("-O", "^has_journal", "-d", str(root), str(half / "disk"), "4G")
        _run("mkfs.ext4", "-q", *size)
        for old in cache.glob("image-*"):
            shutil.rmtree(old)
        half.rename(found)
    return Image(found / "disk", found / "vmlinuz", found / "initrd.img", found / "root")


def compile_for(image: Image, share: Path) -> None:
    """Compile at the speed of this machine what the wheel needs in the guest.

    Args:
        image: The image; its folder gets the wheel, its disk does not.
        share: The folder for the guest, with the wheel; it gets the results.

    Raises:
        subprocess.CalledProcessError: If the wheel cannot be installed or compiled.
    """
    inside = image.root / "mnt" / "host"
    shutil.rmtree(inside)
    shutil.copytree(share, inside)
    python = ("/opt/piezod/bin/python", "-m", "tests.vm.guest.compiled")
    settings = (*KERNELS.split(), "PYTHONPATH=/mnt/host", "NUMBA_CACHE_DIR=/var/cache/piezod")
    _run("chroot", str(image.root), "env", *settings, *python)
    shutil.move(inside / "compiled.tar", share)


def _debian(cache: Path) -> Path:
    """Return an archive with Debian, and nothing of piezod."""
    options = [f"--include={PACKAGES}", "--mode=root", "--variant=minbase"]
    options += [f"--dpkgopt=path-exclude={pattern}" for pattern in _LEFT_OUT]
    for path, text in _INITIAL.items():
        write = f'mkdir -p "$1/{Path(path).parent}"; printf {text!r} > "$1/{path}"'
        options.append(f"--essential-hook={write}")
    found = cache / f"debian-{_digest(SUITE, *options)}.tar"
    if not found.exists():
        _say(f"downloading and installing Debian {SUITE}, about 150 MB (some minutes)")
        half = cache / "debian-half.tar"
        _run("mmdebstrap", "--quiet", *options, SUITE, str(half))
        for old in cache.glob("debian-*.tar"):
            if old != half:
                old.unlink()
        half.rename(found)
    return found


def _unpack(debian: Path, root: Path) -> None:
    root.mkdir()
    _run("tar", "--extract", f"--file={debian}", f"--directory={root}", "--numeric-owner")
    for path, text in _guest_files().items():
        file = root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    (root / "mnt" / "host").mkdir()
    wants = root / "etc/systemd/system/multi-user.target.wants"
    (wants / "piezod-vm.service").symlink_to("/etc/systemd/system/piezod-vm.service")
    for timer in ("apt-daily", "apt-daily-upgrade", "dpkg-db-backup", "e2scrub_all", "fstrim"):
        (root / "etc/systemd/system" / f"{timer}.timer").symlink_to("/dev/null")


def _guest_files() -> dict[str, str]:
    service = (_HERE / "guest" / "piezod-vm.service").read_text(encoding="utf-8")
    return {
        "etc/hostname": "stagepc\n",
        "etc/machine-id": "uninitialized\n",
        "etc/fstab": "host /mnt/host 9p trans=virtio,version=9p2000.L,msize=512000 0 0\n",
        "etc/systemd/system/piezod-vm.service": service,
        "etc/systemd/system.conf.d/vm.conf": f"[Manager]\nDefaultEnvironment={KERNELS}\n",
        "etc/systemd/journald.conf.d/vm.conf": "[Journal]\nStorage=persistent\nRateLimitBurst=0\n",
    }


def _install_libraries(root: Path, wheels: Path) -> None:
    """Install all wheels with the pip of the guest, at the speed of this machine."""
    inside = root / "wheels"
    shutil.copytree(wheels, inside)
    _run("chroot", str(root), "python3", "-m", "venv", "/opt/piezod")
    names = [f"/wheels/{wheel.name}" for wheel in sorted(inside.glob("*.whl"))]
    pip = ("/opt/piezod/bin/pip", "--quiet", "--disable-pip-version-check", "install")
    _run("chroot", str(root), *pip, "--no-index", "--no-deps", *names)
    shutil.rmtree(inside)


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]


def _say(what: str) -> None:
    print(f"make vm: {what}", flush=True)


def _run(*command: str) -> None:
    subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=sys.stderr,
        check=True,
        env={**os.environ, "LC_ALL": "C.UTF-8"},
    )
