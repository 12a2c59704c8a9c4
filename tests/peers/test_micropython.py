"""A firmware by others that the `ascii` driver drives as it is: MicroPython on a micro:bit."""

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import yaml

from piezod.config.devices import DeviceConfig
from piezod.devices import registry
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from tests.conftest import Figure
from tests.daemon.daemons import REPOSITORY, UP_WITHIN_S, Daemon
from tests.daemon.waiting import eventually
from tests.drivers.serial_line.test_ascii_examples import EXAMPLES, device_of
from tests.peers.microbit import Microbit, missing

pytestmark = [
    pytest.mark.peers,
    pytest.mark.skipif(bool(missing()), reason=missing() or "nothing is missing"),
]
TOP: Final = 65_535
FULL_V: Final = 150.0
DISPLAY: Final = 1 << 12
"""The pins below it are those of the board's display, which the firmware uses once it starts."""


@pytest.fixture
def port(tmp_path: Path) -> Path:
    """Return where boards appear."""
    return tmp_path / "tty"


@pytest.fixture
def boards(port: Path) -> Iterator[list[Microbit]]:
    """Switch a board on; those in the list are switched off at the end."""
    made = [Microbit(port)]
    yield made
    for board in made:
        board.close()


def described(port: Path, **changed: object) -> DeviceConfig:
    """Return the device that docs/serial.md describes, at this port."""
    (example,) = (device_of(each) for each in EXAMPLES if "mem32" in each)
    options = example.options.model_dump() | {"port": str(port), **changed}
    return example.model_copy(update={"options": type(example.options).model_validate(options)})


def opened(port: Path, **changed: object) -> Any:
    """Return an active device with these options."""
    described_device = described(port, **changed)
    device: Any = registry.load("ascii").create(described_device.options, Wiring.both(("x",)), 1)
    assert device.open().model == "microbit"
    device.activate(0)
    return device


@pytest.mark.confirms(
    "ascii",
    "ascii",
    part="identity, set-points, readings, read-back, running number, errors",
    by="MicroPython of Debian on an emulated micro:bit",
    kind="real firmware",
)
def test_setpoints_are_at_the_pins(boards: list[Microbit], port: Path, figure: Figure) -> None:
    """Each setpoint is at the pins of the emulated processor, and is what the firmware reads."""
    device, (board,) = opened(port), boards
    codes = [0, 1, TOP, *np.random.default_rng(1).integers(0, TOP, 297, endpoint=True).tolist()]
    for code in codes:
        assert device.write([float(code)], 0)
        assert (board.code(), device.read_back(0)) == (code, [float(code)])
        assert device.read(0)[0].position_um == code
    figure(f"MicroPython at an emulated micro:bit: {len(codes)} setpoints equal")
    device.close()


def test_error_of_the_firmware_is_named(boards: list[Microbit], port: Path) -> None:
    """A setpoint that Python refuses is refused, and the next one is obeyed."""
    wrong = {"send": "m[0x50000504]=range(9)[{x:.0f}]<<4", "reply": "OK\x04"}
    device, (board,) = opened(port, set=(wrong,)), boards
    assert device.write([8.0], 0)
    assert not device.write([9.0], 0)
    assert DeviceFlag.WRONG_REQUEST in device.status(0)[0]
    assert device.write([7.0], 0)
    assert board.code() == 7


def configured(folder: Path, port: Path) -> Path:
    """Write the configuration of a stage without a sensor on such a board."""
    text = (REPOSITORY / "config" / "open-loop.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(text.replace("models/", f"{REPOSITORY}/config/models/"))
    options = described(port).options.model_dump(mode="json", exclude_defaults=True)
    document |= {"rate_hz": 10, "devices": {"board": {"driver": "ascii", "options": options}}}
    gain = {"kind": "line", "gain": FULL_V / TOP}
    document["axes"]["x"]["amplifier"] = {"device": "board", "channel": "x", "calibration": gain}
    path = folder / "board.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def confirmed(daemon: Daemon) -> bool:
    """Reset and arm a stage, as a person does who has looked at the output."""
    daemon.ask("POST", "reset", {})
    return daemon.ask("POST", "arm", {"confirm_output": True}).status_code == 200


def at_the_pins(daemon: Daemon, board: Microbit) -> None:
    """Drive the stage until it stands, and compare its voltage with the pins."""
    daemon.driven(12.5, 60.0)

    def agree() -> bool:
        drive_v = daemon.status()["axes"]["x"]["drive_v"]
        return bool(abs(board.code() / TOP * FULL_V - drive_v) <= FULL_V / TOP)

    eventually(agree)


def test_unplugged_board_is_named(boards: list[Microbit], port: Path, tmp_path: Path) -> None:
    """A board that is unplugged is named; another one there is driven once a person says so."""
    with Daemon(configured(tmp_path, port)) as daemon:
        at_the_pins(daemon.up(), boards[0])
        boards.pop().close()
        boards.append(Microbit(port))
        eventually(lambda: "B1" in daemon.faults(), 30.0)
        eventually(lambda: confirmed(daemon), 60.0)
        at_the_pins(daemon, boards[0])


def test_reset_board_is_named(boards: list[Microbit], port: Path, tmp_path: Path) -> None:
    """A board that was reset answers no more: a fault, and nothing is driven until a new start."""
    with Daemon(configured(tmp_path, port)) as daemon:
        at_the_pins(daemon.up(), boards[0])
        boards[0].reset()
        eventually(lambda: "A1" in daemon.faults(), 30.0)
        daemon.signal(signal.SIGTERM)
        daemon.exit_code()
        assert boards[0].code() < DISPLAY  # as after its start: no voltage of the stage
        daemon.start()
        daemon.until("FAULT", UP_WITHIN_S)  # it did not end at the safe voltage
        eventually(lambda: confirmed(daemon), 60.0)
        at_the_pins(daemon, boards[0])
