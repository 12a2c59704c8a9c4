"""A converter of IIO, as files in a folder."""

import errno
import os
from pathlib import Path

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod.testing.driver_contract import checks_for
from piezod_drivers.kernel.iio import sysfs
from piezod_drivers.kernel.iio.driver import PLUGIN
from piezod_drivers.kernel.iio.options import IioOptions, channels

FILES = {
    "name": "ad5592r",
    "in_voltage_scale": "0.610351562",  # mV; all inputs share it
    "in_voltage0_raw": "2048",
    "in_voltage0-voltage1_raw": "100",
    "out_voltage0_raw": "0",
    "out_voltage0_scale": "2.5",
    "out_voltage0_offset": "-2048",
    "out_voltage0_powerdown": "0",
    "out_current0_raw": "0",
}
NUMBERS = [(errno.ENODEV, DeviceFlag.DISCONNECTED), (errno.EBUSY, DeviceFlag.BUSY)]
NUMBERS += [(errno.EINVAL, DeviceFlag.WRONG_REQUEST), (errno.EACCES, DeviceFlag.PORT_SHARED)]
NUMBERS += [(errno.EIO, DeviceFlag.DEVICE_FAILURE), (errno.ETIMEDOUT, DeviceFlag.LATE_REPLY)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Make the files of a device."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text + "\n", "ascii")
    return tmp_path


def options(folder: Path) -> IioOptions:
    """Return the options for one input and one output."""
    inputs = {"position": {"file": "in_voltage0", "raw": (0, 4095)}}
    outputs = {"drive": {"file": "out_voltage0", "raw": (0, 4095)}}
    return IioOptions.model_validate({"device": str(folder), "inputs": inputs, "outputs": outputs})


def device(folder: Path) -> BusDevice:
    """Construct a device for them."""
    made = PLUGIN.create(options(folder), Wiring(("position",), ("drive",)), 1)
    assert isinstance(made, BusDevice)
    return made


def opened(folder: Path) -> BusDevice:
    """Return an open and active device."""
    made = device(folder)
    made.open()
    made.activate(0)
    return made


def test_driver_keeps_the_contract(folder: Path, subtests: pytest.Subtests) -> None:
    """It passes every check of its roles."""
    for check in checks_for(lambda: device(folder)):
        with subtests.test(check.__name__):
            check(lambda: device(folder))


def test_values_have_scale_and_offset(folder: Path) -> None:
    """A value is scale · (raw + offset), in V, by the file of the channel or of its type."""
    made = opened(folder)
    assert made.read(0)[0].position_um == pytest.approx(2048 * 0.610351562e-3)
    assert made.capabilities().ranges == ((-5.12, 5.1175),)
    assert made.write([1.0], 0)
    assert (folder / "out_voltage0_raw").read_text("ascii").split("\n")[0] == "2448"
    assert made.read_back(1) == [1.0]
    assert not made.write([5.2], 0)


def test_units_are_those_of_the_names() -> None:
    """V, mA and µm; anything else counts raw steps."""
    files = {"a": "in_voltage0-voltage1", "b": "in_distance", "c": "in_intensity0"}
    made = IioOptions.model_validate(
        {
            "device": "x",
            "inputs": {name: {"file": file} for name, file in files.items()},
            "outputs": {"d": {"file": "out_current0", "raw": (0, 1)}},
        }
    )
    assert channels(made) == ({"a": "V", "b": "µm", "c": "raw"}, {"d": "mA"})


@pytest.mark.sees("iio", "S7")
@pytest.mark.parametrize("raw", [0, 4095])
def test_sample_at_an_end_is_saturated(folder: Path, raw: int) -> None:
    """It is not valid, and the status says why."""
    made = opened(folder)
    (folder / "in_voltage0_raw").write_text(f"{raw}\n", "ascii")
    assert not made.read(0)[0].valid
    assert made.status(0) == [frozenset({DeviceFlag.SATURATED}), frozenset()]


@pytest.mark.sees("iio", "A1")
@pytest.mark.sees("iio", "B1")
@pytest.mark.sees("iio", "B10")
@pytest.mark.sees("iio", "B14")
@pytest.mark.parametrize(("number", "flag"), NUMBERS)
def test_error_of_the_kernel_is_a_value(
    folder: Path, monkeypatch: pytest.MonkeyPatch, number: int, flag: DeviceFlag
) -> None:
    """Samples are invalid, writes are refused; the status says why."""

    def refused(*_: object) -> bytes:
        raise OSError(number, os.strerror(number))

    made = opened(folder)
    monkeypatch.setattr(os, "pread", refused)
    monkeypatch.setattr(os, "pwrite", refused)
    (sample,) = made.read(0)
    assert (sample.valid, made.write([1.0], 0)) == (False, False)
    assert all(flag in each for each in made.status(0))


@pytest.mark.sees("iio", "A3")
@pytest.mark.sees("iio", "A12")
def test_output_is_read_back_from_the_kernel(folder: Path) -> None:
    """What another program writes is seen."""
    made = opened(folder)
    made.write([1.0], 0)
    (folder / "out_voltage0_raw").write_text("0\n", "ascii")
    assert made.read_back(1) == [-5.12]


@pytest.mark.sees("iio", "S10")
def test_other_chip_is_noticed(folder: Path) -> None:
    """If another chip is found when it is opened again, each channel says so."""
    made = opened(folder)
    made.close()
    (folder / "name").write_text("ad5593r\n", "ascii")
    made.open()
    assert all(DeviceFlag.OTHER_DEVICE in each for each in made.status(0))


@pytest.mark.parametrize(
    ("change", "text", "said"),
    [
        ("out_voltage0_powerdown", "1", "powered down"),
        ("in_voltage_scale", "loud", "expected a number"),
        ("in_voltage_scale", None, "give `scale`, the V"),
        ("in_voltage0_raw", None, "no device"),
        ("in_voltage0_raw", "12 V", "12 V"),
    ],
)
def test_unusable_file_is_named(folder: Path, change: str, text: str | None, said: str) -> None:
    """A device that is not as configured is not taken, or its sample is no sample."""
    if text is None:
        (folder / change).unlink()
    else:
        (folder / change).write_text(text + "\n", "ascii")
    made = device(folder)
    try:
        made.open()
        made.activate(0)
        assert not made.read(0)[0].valid
        assert said in made.last_fault
    except DeviceError as error:
        assert said in str(error)


def test_device_is_found_by_the_name_of_its_chip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exactly one may have it; the refusal lists what there is, or the folders to choose from."""
    monkeypatch.setattr(sysfs, "DEVICES", tmp_path)
    for number, name in enumerate(("ads1115", "ad5686", "ads1115")):
        (tmp_path / f"iio:device{number}").mkdir()
        (tmp_path / f"iio:device{number}" / "name").write_text(name + "\n", "ascii")
    assert sysfs.folder_of("ad5686") == tmp_path / "iio:device1"
    with pytest.raises(DeviceUnavailableError, match="ads1115, ad5686"):
        sysfs.folder_of("ltc2688")
    with pytest.raises(DeviceError, match="iio:device2"):
        sysfs.folder_of("ads1115")
    with pytest.raises(DeviceUnavailableError, match="overlay"):
        sysfs.folder_of(str(tmp_path / "iio:device9"))
