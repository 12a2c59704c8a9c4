"""Converters of IIO: the kernel's drivers of a DAC and an ADC, on registers that i2c-stub keeps.

A process of its own is the stage between them: it reads the register of the DAC, and writes the
position into that of the ADC.
"""

import fcntl
import os
import time
from ctypes import POINTER, Structure, c_uint8, c_uint16, c_uint32, pointer
from pathlib import Path
from typing import Any, Final

from piezod.devices import registry
from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from tests.vm.guest import shell
from tests.vm.guest.buses import driven, faulted, recovered
from tests.vm.guest.shell import CheckError, need, run, wait_until
from tests.vm.guest.stage import Stage

DAC, ADC = 0x10, 0x48
"""Addresses of a DS4424 and an ADS1015."""
DAC_REGISTER, ADC_REGISTER = 0xF8, 0x00
STEPS: Final = 127
FULL_V: Final = 150.0
FULL_UM: Final = 40.0
"""Position at the highest code of the ADC."""
STEP_V: Final = FULL_V / STEPS
PLANT: Final = "stage-on-i2c"
DEVICES: Final = Path("/sys/bus/iio/devices")
DROP_IN: Final = Path("/etc/systemd/system/piezod@chip.service.d/iio.conf")
STAGE: Final = Stage(
    "chip",
    "devices/iio.yaml",
    (
        ("rate_hz: 500", "rate_hz: 20"),
        ("device: ad5686r", "device: ds4424"),
        (
            "drive: {file: out_voltage0, raw: .*}",
            "drive: {file: out_current0, raw: [0, 127], scale: 0.01}",
        ),
        ("device: ads8688", "device: ads1015"),
        ("position: {file: in_voltage0, raw: .*}", "position: {file: in_voltage0}"),
        ("gain: 30}", f"gain: {FULL_V / 1.27}}}"),
        ("gain: 5}", f"gain: {FULL_UM / 2.047}}}"),
        ("    first_mode: .*\n", ""),
        ("    model: .*\n    compensator: .*\n    trim: .*\n", ""),
        ("slew_v_per_s: 10000", "slew_v_per_s: 200"),
        ("speed_um_per_s: 100", "speed_um_per_s: 10"),
        ("tolerance_um: 0.1", "tolerance_um: 1"),
    ),
)


class _Data(Structure):
    """Bytes of a transfer on SMBus."""

    _fields_ = (("word", c_uint16), ("rest", c_uint8 * 32))


class _Request(Structure):
    """A transfer, as the kernel's i2c-dev takes it."""

    _fields_ = (
        ("read", c_uint8),
        ("register", c_uint8),
        ("size", c_uint32),
        ("data", POINTER(_Data)),
    )


class Bus:
    """The bus of i2c-stub, from user space."""

    BYTE, WORD = 2, 3

    def __init__(self) -> None:
        self._file = os.open(f"/dev/{adapter().name}", os.O_RDWR)

    def transfer(self, chip: int, register: int, size: int, value: int | None = None) -> int:
        """Write a register, or read it; return its value."""
        fcntl.ioctl(self._file, 0x0706, chip)  # also a chip that the kernel drives
        data = _Data(word=value or 0)
        request = _Request(value is None, register, size, pointer(data))
        fcntl.ioctl(self._file, 0x0720, request)
        return int(data.word) & (0xFF if size == self.BYTE else 0xFFFF)

    def drive_v(self) -> float:
        """Return the voltage that the register of the DAC stands for: bit 7 is its direction."""
        raw = self.transfer(DAC, DAC_REGISTER, self.BYTE)
        return (raw & 0x7F) * STEP_V if raw & 0x80 else 0.0

    def set_position(self, position_um: float) -> None:
        """Write a position into the register of the ADC: 12 bits on the left, high byte first."""
        code = max(-2048, min(2047, round(position_um / FULL_UM * 2047))) << 4 & 0xFFFF
        self.transfer(ADC, ADC_REGISTER, self.WORD, (code & 0xFF) << 8 | code >> 8)


def adapter() -> Path:
    """Return the folder of the bus of i2c-stub."""
    for folder in Path("/sys/bus/i2c/devices").glob("i2c-*"):
        if "stub" in (folder / "name").read_text("ascii"):
            return folder
    raise CheckError("there is no bus of i2c-stub")


def plant() -> None:
    """Be the stage between both chips, for ever: a simulated one of the project."""
    driver, bus = registry.load("simulated"), Bus()
    rig: Any = driver.create(driver.options_model(), Wiring(("x",), ("x",)), 1)
    rig.open()
    rig.activate(time.monotonic_ns())
    while True:
        now_ns = time.monotonic_ns()
        rig.write([bus.drive_v()], now_ns)
        bus.set_position(rig.read(now_ns)[0].position_um)
        time.sleep(0.01)


def chips_are_there() -> str:
    """Load the kernel's drivers, and start the stage."""
    run(f"modprobe i2c-dev && modprobe i2c-stub chip_addr={DAC},{ADC}")
    for name, address in (("ds4424", DAC), ("ti-ads1015", ADC)):
        run(f"modprobe {name}")
        new = f"{name.removeprefix('ti-')} {address:#x}"
        run(f"echo {new} > {adapter()}/new_device")
    code = "from tests.vm.guest.iio import plant; plant()"
    run(
        f"systemd-run --unit={PLANT} -E PYTHONPATH=/mnt/host -E NUMBA_CACHE_DIR=/var/cache/piezod "
        f'/opt/piezod/bin/python -c "{code}"'
    )
    wait_until(lambda: Bus().transfer(ADC, ADC_REGISTER, Bus.WORD), "the stage writes a position")
    return ", ".join((folder / "name").read_text().strip() for folder in DEVICES.glob("iio:*"))


@shell.confirms(
    "iio", "iio", part="set-points and read-back", by="ds4424 of Linux 6.1", kind="kernel driver"
)
def setpoints_reach_the_register() -> str:
    """Each set-point of the driver is in the register of the DAC, and is read back."""
    plugin, bus = registry.load("iio"), Bus()
    options = {
        "device": "ds4424",
        "outputs": {"out": {"file": "out_current0", "raw": (0, STEPS), "scale": STEP_V}},
    }
    dac: Any = plugin.create(plugin.options_model.model_validate(options), Wiring((), ("out",)), 1)
    dac.open()
    dac.activate(0)
    begin_ns = time.monotonic_ns()
    for raw in range(STEPS + 1):
        need(dac.write([raw * STEP_V], raw), f"step {raw} is refused")
        found = (bus.drive_v() / STEP_V, dac.read_back(raw)[0] / STEP_V)
        need(all(abs(each - raw) < 1e-6 for each in found), f"step {raw} is {found}")
    taken_us = (time.monotonic_ns() - begin_ns) / 1e3 / (STEPS + 1)
    need(not dac.write([FULL_V + 2 * STEP_V], 999), "a voltage out of range is accepted")
    dac.write([0.0], 1000)
    dac.close()
    return f"{STEPS + 1} steps equal; write, look and read-back take {taken_us:.0f} µs here"


def user_without_rights_is_told() -> str:
    """The files of an output belong to root until a rule of udev gives them away."""
    code = (
        "from tests.vm.guest.iio import setpoints_reach_the_register as check\n"
        "from piezod.errors import DeviceError\n"
        "import tests.vm.guest.iio as iio\n"
        "iio.Bus = object\n"
        "try:\n  check()\nexcept DeviceError as e: print(e)"
    )
    said = run(f'runuser -u nobody -- env PYTHONPATH=/mnt/host /opt/piezod/bin/python -c "{code}"')
    need("no access" in said, said)
    return said


def wrong_device_is_named() -> str:
    """A chip that is not there, and a channel without a scale, are refused with what there is."""
    plugin, said = registry.load("iio"), []
    for device, file in (("ad5686r", "out_voltage0"), ("ds4424", "out_current0")):
        options = {"device": device, "outputs": {"out": {"file": file, "raw": (0, 100)}}}
        made = plugin.options_model.model_validate(options)
        try:
            plugin.create(made, Wiring((), ("out",)), 1).open()
        except DeviceError as error:
            said.append(str(error))
    need(len(said) == 2, f"only {said}")
    return "; ".join(said)


def stage_drives() -> str:
    """Close the loop at 20 Hz as a service; the position comes from the register of the ADC."""
    STAGE.configure()
    give_away()
    STAGE.start()
    return f"{driven(STAGE)}, {STAGE.status().axes['x'].position_um} µm"


def give_away() -> None:
    """Let the service write the output, as the page on a Raspberry Pi says."""
    DROP_IN.parent.mkdir(parents=True, exist_ok=True)
    DROP_IN.write_text("[Service]\nReadWritePaths=/sys/devices\n", "utf-8")
    run(f"systemctl daemon-reload && chown piezod {DEVICES}/*/out_*_raw")


def chip_is_removed() -> str:
    """Remove the DAC in the middle of it, and bring it back: B1, and a person resets the stage."""
    run(f"echo {DAC:#x} > {adapter()}/delete_device")
    seen = faulted(STAGE, "B1")
    run(f"echo ds4424 {DAC:#x} > {adapter()}/new_device")
    give_away()
    return f"{seen}; {recovered(STAGE)}"


def stop_leaves_rest() -> str:
    """`systemctl stop` ramps to 0 V, which stays in the register."""
    STAGE.stop()
    DROP_IN.unlink()
    DROP_IN.parent.rmdir()
    found_v = Bus().drive_v()
    run(f"systemctl stop {PLANT}")
    need(found_v == 0.0, f"the output is {found_v} V")
    return f"{found_v} V"
