"""The waveform generator and the data recorder of the emulated NV200/D, in virtual time."""

from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import TestTime

MS = 1_000_000


def emulated() -> tuple[PsjEmulator, TestTime]:
    """Return the device, and its time."""
    table, _, time = bench()
    return PsjEmulator("nv200", table, ""), time


def ask(device: PsjEmulator, *commands: str) -> str:
    """Send commands; return the reply to the last one."""
    for command in commands:
        (reply,) = device.receive(f"{command}\r".encode())
    return reply.decode().strip("\x11\x13\r\n")


def test_generator_ends_after_its_cycles_when_the_recorder_ends_before() -> None:
    """A recorder that ends between two points leaves the points where they are."""
    device, time = emulated()
    points = [f"gbarb,{i},{10.0 * i}" for i in range(5)]
    ask(device, *points, "gearb,4", "gcarb,2", "gtarb,10", "recast,2", "reclen,100", "recrun,1")
    ask(device, "modsrc,3", "grun,1")
    time.t_ns += 4 * MS
    during = ask(device, "grun")
    time.t_ns += 2 * MS

    assert (during, ask(device, "grun"), ask(device, "recrun")) == ("grun,1", "grun,0", "recrun,0")
    assert ask(device, "recidx") == "recidx,100"


def test_a_sample_is_there_when_the_request_for_it_has_arrived() -> None:
    """The first samples are recorded while the line carries the request."""
    device, _ = emulated()
    ask(device, "set,40", "recast,0", "recsrc,0,2", "recstr,1", "reclen,20", "recrun,1")

    assert [ask(device, f"recout,0,{i},1") for i in (0, 1)] == [
        "recout,0,0,40.000",
        "recout,0,1,40.000",
    ]
