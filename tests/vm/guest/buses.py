"""Stages behind a USB adapter and behind a CAN controller, and what is done to their plugs."""

from pathlib import Path
from typing import Final

from piezod.errors import RefusedError
from tests.vm.guest.host import Host
from tests.vm.guest.shell import PIEZOD, CheckError, attempt, need, run, wait_until
from tests.vm.guest.stage import Stage

ADAPTER: Final = "OURS"
"""Serial number of the USB adapter."""
PORT: Final = Path("/dev/piezod", ADAPTER)
"""The lasting name that the udev rule of piezod gives it."""
TARGET_UM: Final = 12.5
DRIVEN_V: Final = 30.0
USB: Final = Stage(
    "usb",
    "open-loop.yaml",
    (
        ("rate_hz: 200", "rate_hz: 10"),
        (
            "driver: simulated, options: .*}}",
            f"driver: thorlabs_mdt, options: {{port: {PORT}, timeout_ms: 900}}}}",
        ),
        ("amplifier: amplifier", "amplifier: {device: amplifier, channel: x}"),
    ),
)
CAN: Final = Stage(
    "can",
    "devices/canopen-401.yaml",
    (
        ("rate_hz: 500.*", "rate_hz: 10"),
        ("timeout_ms: 5", "timeout_ms: 900"),
        ("watchdog_ms: 200", "watchdog_ms: 10000"),
    ),
)
CONTROLLER: Final = Path("/sys/class/net/can0/device")


def usb_stage_drives(host: Host) -> str:
    """Plug the adapter in, and drive the amplifier behind it.

    The node of the next stage starts meanwhile, on the other processor.
    """
    _start_node()
    host.plug(ADAPTER)
    wait_until(PORT.exists, f"{PORT}")
    USB.configure()
    USB.start()
    return f"{PORT} is {PORT.resolve().name}; {_driven(USB)}"


def usb_unplugged(host: Host) -> str:
    """Unplug the adapter and plug it in again; a person resets the stage, and it drives again.

    Then the stage ends: an emulated processor is too slow for one more beside the others.
    """
    node = PORT.resolve().name
    host.unplug(ADAPTER)
    seen = _faulted(USB, "B1")
    host.plug(ADAPTER)
    wait_until(PORT.exists, f"{PORT}")
    recovered = f"{PORT.resolve().name}: {_recovered(USB)}"
    USB.stop()
    return f"{node} gone: {seen}; {recovered}"


def can_stage_drives() -> str:
    """Drive a node at the other controller of the bus."""
    CAN.configure()
    CAN.start()
    return _driven(CAN)


def _start_node() -> None:
    """Bring the bus up, and start the emulated node at its other end."""
    for name in ("can0", "can1"):
        _up(name)
    node = "emulate canopen-401 --port socketcan:can1"
    run(
        f"systemd-run --unit=node --uid=piezod -E NUMBA_CACHE_DIR=/var/cache/piezod {PIEZOD} {node}"
    )


def can_other_end_down() -> str:
    """No node acknowledges or answers: the nearest that QEMU has to a bus off."""
    run("ip link set can1 down")
    try:
        seen = _faulted(CAN, "A1", "B1", "B5")
    finally:
        _up("can1")
    return f"{seen}; {_recovered(CAN)}"


def can_down() -> str:
    """Take the interface down and up."""
    run("ip link set can0 down")
    try:
        seen = _faulted(CAN, "B1")
    finally:
        _up("can0")
    return f"{seen}; {_recovered(CAN)}"


def can_removed() -> str:
    """Remove the controller from the PCI bus, and bring it back."""
    (CONTROLLER.resolve() / "remove").write_text("1")
    seen = _faulted(CAN, "B1")
    Path("/sys/bus/pci/rescan").write_text("1")
    wait_until(CONTROLLER.exists, "can0")
    _up("can0")
    return f"{seen}; {_recovered(CAN)}"


def devices_are_restricted() -> str:
    """In the service's control group the adapter can be opened, and the disk cannot."""
    group = Path(
        "/sys/fs/cgroup" + run(f"systemctl show --value --property=ControlGroup {USB.unit}")
    )
    opened = {
        name: _opened_in(group, name) for name in (str(PORT.resolve()), "/dev/vda", "/dev/ttyS0")
    }
    need(list(opened.values()) == ["opened", "EPERM", "EPERM"], f"{opened}")
    return ", ".join(f"{name} {how}" for name, how in opened.items())


def _opened_in(group: Path, device: str) -> str:
    """Open a device as root in a control group; return how that ends."""
    join = f"open('{group}/cgroup.procs', 'w').write(str(os.getpid()))"
    attempted = f"os.open('{device}', os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)"
    ended = attempt(f'python3 -c "import os; {join}; {attempted}"')
    if not ended.returncode:
        return "opened"
    return "EPERM" if "Operation not permitted" in ended.stderr else ended.stderr.strip()


def _up(name: str) -> None:
    """Bring an interface up, as docs/can.md says."""
    run(f"ip link set {name} up txqueuelen 4 type can bitrate 500000 restart-ms 0")


def _driven(stage: Stage) -> str:
    """Arm a stage that is at rest, have it drive, and return where it is."""
    stage.arm()
    with stage.client() as client:

        def accepted() -> bool:
            try:
                client.goto(TARGET_UM)
            except RefusedError:  # the emulated processor was too busy: it says to try again
                return False
            return True

        wait_until(accepted, "the stage takes a position")
        stage.wait_for("RUN")
        wait_until(lambda: (client.status().axes["x"].drive_v or 0.0) > DRIVEN_V, "a voltage")
        axis = client.status().axes["x"]
    return f"{axis.drive_v:.1f} V"


def _faulted(stage: Stage, *faults: str) -> str:
    """Wait until a stage reports one of these faults; return its state and all faults."""
    try:
        wait_until(lambda: stage.faults() & set(faults), f"{' or '.join(faults)} of {stage.name}")
    except CheckError as error:
        raise CheckError(f"{error}; it has {_condition(stage)}") from error
    return _condition(stage)


def _condition(stage: Stage) -> str:
    status = stage.status()
    return f"{status.state} with {', '.join(each.id for each in status.faults) or 'no fault'}"


def _recovered(stage: Stage) -> str:
    """Reset a stage whose device is back, and have it drive again; return where it is."""
    stage.reset()
    return f"reset, then {_driven(stage)}"
