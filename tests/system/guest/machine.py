"""A guest in QEMU with its own kernel, for buses that the kernel of this machine may not have.

Its root is this machine's file system, read-only, so that it has interpreter and libraries of the
test at the same places. It has two CAN controllers on one bus, and a USB controller; the test plugs
and unplugs USB serial adapters.
"""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from tests.system.guest.kernel import Kernel
from tests.system.guest.monitor import Monitor, connected

_HERE: Final = Path(__file__).parent
_REPOSITORY: Final = _HERE.parents[2]
_QEMU: Final = "qemu-system-x86_64"
_NEEDED: Final = (
    *(_QEMU, "busybox", "cpio", "dpkg-deb", "apt-get", "modprobe", "depmod"),
    *("udevadm", "ip", "stty"),
)
_MODULES: Final = ("can_raw", "can_bcm", "vcan", "kvaser_pci", "sch_plug", "xhci_pci", "ftdi_sio")
_BOOT_S: Final = 300.0
_COMMAND_S: Final = 900.0


def why_not() -> str:
    """Return why no guest can be booted here, or ""."""
    if os.geteuid() != 0:
        return "only root can share all files with a guest"
    missing = [name for name in _NEEDED if shutil.which(name) is None]
    return f"not installed: {', '.join(missing)}" if missing else ""


class Guest:
    """A running guest."""

    def __init__(self, share: Path, control: socket.socket, monitor: Monitor) -> None:
        self._share = share
        control.settimeout(_COMMAND_S)
        self._control = control.makefile("rw", encoding="utf-8", newline="\n")
        self._monitor = monitor

    def close(self) -> None:
        """Close the connection for commands."""
        self._control.close()

    def wait_until_booted(self) -> None:
        """Wait until it accepts commands."""
        assert self._serve() == 0

    def run(self, command: str) -> tuple[int, str]:
        """Run a shell command in it.

        Meanwhile it may request that an adapter is plugged or unplugged.

        Returns:
            The exit code and the output.
        """
        self._send(command)
        code = self._serve()
        return code, (self._share / "output").read_text("utf-8", "replace")

    def check(self, name: str, *arguments: str) -> tuple[int, str]:
        """Run the tests of a file of this folder in it; return their exit code and report."""
        tests = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:randomly"]
        options = ["-n0", "-rA", "-m", "''", "--rootdir", str(_REPOSITORY), *arguments]
        command = " ".join([*tests, *options, str(_HERE / name)])
        return self.run(f"cd {_REPOSITORY} && PIEZOD_GUEST=1 {command}")

    def _serve(self) -> int:
        """Execute the requests of the guest until its command has ended; return the exit code."""
        for line in self._control:
            word, _, rest = line.strip().partition(" ")
            match word:
                case "done":
                    return int(rest)
                case "plug":
                    identity, _, chardev = rest.partition(" ")
                    self._send(self._monitor.plug(identity, chardev))
                case "unplug":
                    self._send(self._monitor.unplug(rest))
        raise AssertionError("the guest has ended")

    def _send(self, line: str) -> None:
        self._control.write(line + "\n")
        self._control.flush()


@contextmanager
def booted(kernel: Kernel, console: Path, far_end: str) -> Iterator[Guest]:
    """Boot a guest; it is switched off when the block ends.

    Args:
        kernel: The kernel to boot.
        console: File for the messages of the kernel.
        far_end: Serial port or pty behind a USB adapter at `wire`.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pz-guest-")))
        share = folder / "share"
        share.mkdir()
        shutil.copy(_HERE / "start.sh", share)
        command = _command(kernel, folder, console, far_end)
        process = stack.enter_context(subprocess.Popen(command, stdin=subprocess.DEVNULL))
        stack.callback(process.kill)
        control = stack.enter_context(connected(process, folder / "control"))
        monitor = stack.enter_context(Monitor(connected(process, folder / "monitor")))
        guest = Guest(share, control, monitor)
        stack.callback(guest.close)
        control.settimeout(_BOOT_S)
        guest.wait_until_booted()
        control.settimeout(_COMMAND_S)
        code, output = guest.run(f"modprobe --dirname={kernel.modules} --all {' '.join(_MODULES)}")
        assert code == 0, output
        yield guest


def _command(kernel: Kernel, folder: Path, console: Path, far_end: str) -> list[str]:
    machine = "-nodefaults -no-user-config -machine q35 -cpu max -smp 2 -m 1024 -display none"
    emulation = "-accel tcg,thread=multi -no-reboot"
    log = "console=ttyS0 quiet panic=-1 net.ifnames=0 mitigations=off"
    nine = "security_model=none,multidevs=remap"
    return [
        _QEMU,
        *machine.split(),
        *emulation.split(),
        *("-kernel", str(kernel.image), "-initrd", str(kernel.initial), "-append", log),
        *("-serial", f"file:{console}"),
        *("-chardev", f"socket,id=control,path={folder}/control,server=on,wait=off"),
        *("-serial", "chardev:control"),
        *("-qmp", f"unix:{folder}/monitor,server=on,wait=off"),
        *("-virtfs", f"local,path=/,mount_tag=root,readonly=on,{nine}"),
        *("-virtfs", f"local,path={folder}/share,mount_tag=share,{nine}"),
        *("-object", "can-bus,id=bus"),
        *("-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus"),
        *("-device", "qemu-xhci,id=usb"),
        *("-chardev", f"serial,id=wire,path={far_end}"),
        *("-chardev", f"file,id=nothing,path={folder}/nothing"),
    ]
