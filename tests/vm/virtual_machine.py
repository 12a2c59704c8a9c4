"""The virtual machine in QEMU: a PC with two CAN controllers on one bus, and a USB controller.

Everything that it writes is lost at the end, except for the files in the folder that it shares.
"""

import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from tests.system.guest.monitor import Monitor, connected
from tests.vm.image import PORT, Image

BEHIND_USB: Final = "amplifier"
"""Name, for the monitor, of what is at the other end of a USB adapter."""
_QEMU: Final = "qemu-system-x86_64"
# Emulated even where there is a KVM: nested in another machine, it may start and then hang.
_PC: Final = "-machine q35 -accel tcg,thread=multi -cpu Nehalem -smp 2 -m 2048"
_BARE: Final = "-nodefaults -no-user-config -no-reboot -display none -device virtio-rng-pci"
_KERNEL: Final = "root=/dev/vda rw console=ttyS0 quiet panic=-1 net.ifnames=0"
# Tests of the kernel, and what a real processor needs, take an emulated one long.
_BRISK: Final = "mitigations=off cryptomgr.notests"


@contextmanager
def booted(
    image: Image, folder: Path, share: Path, far_end: str
) -> Iterator[tuple[socket.socket, Monitor]]:
    """Boot it, and switch it off when the block ends.

    Args:
        image: What boots.
        folder: Empty folder with a short path, for sockets and for what the guest writes.
        share: Folder that guest and host can write to, /mnt/host in the guest.
        far_end: Serial port or pty behind a USB adapter.

    Yields:
        The port to the guest, and the monitor.
    """
    overlay = ("-b", str(image.disk), "-F", "raw", str(folder / "disk"))
    subprocess.run(["qemu-img", "create", "-q", "-f", "qcow2", *overlay], check=True)  # noqa: S607
    with ExitStack() as stack:
        process = stack.enter_context(
            subprocess.Popen(_command(image, folder, share, far_end), stdin=subprocess.DEVNULL)
        )
        stack.callback(process.kill)
        port = stack.enter_context(connected(process, folder / "port"))
        yield port, stack.enter_context(Monitor(connected(process, folder / "monitor")))


def _command(image: Image, folder: Path, share: Path, far_end: str) -> list[str]:
    disk = f"file={folder}/disk,if=virtio,format=qcow2,cache=unsafe"
    return [
        *("nice", "-n", "5", _QEMU, *_PC.split(), *_BARE.split()),
        *(
            "-kernel",
            str(image.kernel),
            "-initrd",
            str(image.initial),
            "-append",
            f"{_KERNEL} {_BRISK}",
        ),
        *("-serial", f"file:{share}/console.txt"),
        *("-drive", disk),
        *("-virtfs", f"local,path={share},mount_tag=host,security_model=none,multidevs=remap"),
        *("-qmp", f"unix:{folder}/monitor,server=on,wait=off"),
        *("-device", "virtio-serial-pci"),
        *("-chardev", f"socket,id=port,path={folder}/port,server=on,wait=off"),
        *("-device", f"virtserialport,chardev=port,name={PORT}"),
        *("-object", "can-bus,id=bus"),
        *("-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus"),
        *("-device", "qemu-xhci,id=usb"),
        *("-chardev", "null,id=printer", "-device", "isa-parallel,chardev=printer"),
        *("-chardev", f"serial,id={BEHIND_USB},path={far_end}"),
    ]
