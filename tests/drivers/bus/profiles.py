"""One row for each device that can be emulated at a pty or a TCP port, with its driver.

`test_generic*.py` runs with each of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from piezod.devices import registry
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.piezo_board.emulation.build import missing

Options = Callable[[str, float], Mapping[str, object]]
"""Options of a driver for a place, as `piezod emulate` prints it, and a time-out in ms."""


@dataclass(frozen=True)
class Profile:
    """A device and its driver."""

    name: str  #: Name of the profile, as in `piezod emulate`.
    driver: str  #: Name of the driver.
    wiring: Wiring  #: Channels of the device, all of them in use.
    options: Options  #: Options of the driver.
    arguments: tuple[str, ...] = ()  #: Arguments of `piezod emulate`.
    #: Ids of faults that the driver detects, but not for this device.
    unseen: frozenset[str] = frozenset()
    streams: bool = False  #: Whether it sends by itself, so that the age of a value is unknown.
    #: Whether its faults and its fuzzing are left to `make stress`, because another profile of its
    #: driver shows the same.
    takes_long: bool = False
    #: Waits of the driver, in ns by constant, that are shorter in tests of faults: an emulated
    #: device sends a reply in one piece.
    shorter: Mapping[str, int] = field(default_factory=dict)

    def maker(self, where: str, timeout_ms: float = 2000.0) -> Callable[[], Any]:
        """Return a function that constructs the device for a place, with a time-out for replies."""
        plugin = registry.load(self.driver)
        options = plugin.options_model.model_validate(dict(self.options(where, timeout_ms)))
        return lambda: plugin.create(options, self.wiring, 1)


@dataclass(frozen=True)
class Port:
    """Options of a driver with `port` and `timeout_ms`."""

    others: Mapping[str, object] = field(default_factory=dict)  #: The other options.

    def __call__(self, where: str, timeout_ms: float) -> Mapping[str, object]:
        """Return the options for a place."""
        return {"port": where, "timeout_ms": timeout_ms, **self.others}


@dataclass(frozen=True)
class Tcp:
    """Options of a driver with `host`, `tcp_port` and `timeout_ms`."""

    others: Mapping[str, object] = field(default_factory=dict)  #: The other options.

    def __call__(self, where: str, timeout_ms: float) -> Mapping[str, object]:
        """Return the options for a place."""
        host, _, port = where.rpartition(":")
        return {"host": host, "tcp_port": int(port), "timeout_ms": timeout_ms, **self.others}


def _modbus(
    name: str,
    wiring: Wiring,
    options: Options,
    unseen: str = "A7 A8 S10",
    arguments: tuple[str, ...] = (),
    *,
    takes_long: bool = False,
) -> Profile:
    blind = frozenset([*unseen.split(), *(["B4"] if isinstance(options, Tcp) else [])])
    return Profile(name, "modbus", wiring, options, arguments, blind, takes_long=takes_long)


def _units(*profiles: str) -> dict[str, object]:
    return {"units": tuple({"unit": i + 1, "profile": name} for i, name in enumerate(profiles))}


MODBUS = (
    *(
        _modbus(
            name,
            Wiring(("AIN0",), ("DAC0",)),
            Tcp({"profile": name}),
            "",
            takes_long=name != "labjack-t7",
        )
        for name in ("labjack-t4", "labjack-t7", "labjack-t8")
    ),
    _modbus(
        "adam-6024",
        Wiring(("AI0",), ("AO0",)),
        Tcp({"profile": "adam-6024"}),
        takes_long=True,
    ),
    _modbus("wago-750", Wiring(("AI0",), ("AO0",)), Tcp({"profile": "wago-750"})),
    _modbus("adam-4024", Wiring((), ("AO0",)), Port({"profile": "adam-4024"})),
    _modbus(
        "icpdas",
        Wiring(("AI0",), ("AO0",)),
        Port(_units("icpdas-m7017", "icpdas-m7024")),
        takes_long=True,
    ),
    _modbus(
        "waveshare",
        Wiring(("AI1",), ("AO1",)),
        Port(_units("waveshare-ai8b", "waveshare-ao8b")),
        takes_long=True,
    ),
)

_MDT_WAITS = {"piezod_drivers.serial_line.thorlabs_mdt.dialogue._QUIET_NS": 5_000_000}
_NO_READ_BACK = frozenset({"A3", "A12"})

ASCII_DEMO = {
    "outputs": {"X": {"unit": "µm", "lowest": 0.0, "highest": 26.0}},
    "inputs": {"X": {}},
    "identify": {"send": "INFOX", "reply": r"(?P<model>\S+) um (?P<serial>\S+)"},
    "set": ({"send": "MOVEX {X:.4f}u", "reply": "Ok"},),
    "read": ({"send": "GET_X", "reply": r"(?P<X>-?\d+\.\d+) um"},),
    "errors": ({"pattern": "Error.*", "flag": "wrong request"},),
}
ASCII_SENSOR = {
    "terminator": "\r\n",
    "inputs": {"x": {}},
    "stream": r"P (?P<x>-?\d+\.\d+) um",
    "errors": ({"pattern": "P saturated", "flag": "saturated"},),
}

PROFILES = (
    *MODBUS,
    Profile(
        "pi-e816",
        "pi_gcs1",
        Wiring.both(("A", "B")),
        Port({"axes": ("A", "B")}),
        ("--axes", "2"),
    ),
    Profile("pi-gcs2", "pi_gcs2", Wiring.both(("1",)), Port()),
    Profile(
        "pi-gcs2-tcp",
        "pi_gcs2",
        Wiring.both(("1", "2")),
        Tcp({"axes": ("1", "2")}),
        ("--axes", "2"),
    ),
    Profile(
        "mdt693a",
        "thorlabs_mdt",
        Wiring((), ("x",)),
        Port(),
        takes_long=True,
        shorter=_MDT_WAITS,
        unseen=frozenset({"S10"}),  # it reports no serial number
    ),
    Profile(
        "mdt693b",
        "thorlabs_mdt",
        Wiring((), ("x", "y", "z")),
        Port(),
        ("--axes", "3"),
        shorter=_MDT_WAITS,
    ),
    Profile(
        "mdt694b",
        "thorlabs_mdt",
        Wiring((), ("x",)),
        Port(),
        takes_long=True,
        shorter=_MDT_WAITS,
    ),
    Profile("kpz101", "thorlabs_apt", Wiring((), ("1",)), Port({"model": "KPZ101"})),
    Profile("ksg101", "thorlabs_apt", Wiring(("1",), ()), Port({"model": "KSG101"})),
    Profile("lc400", "npoint_lc400", Wiring.both(("1",)), Port()),
    Profile(
        "ild1420",
        "micro_epsilon",
        Wiring(("distance",), ()),
        Port({"model": "ILD1420"}),
        streams=True,
    ),
    Profile(
        "odc2520",
        "micro_epsilon",
        Wiring(("distance",), ()),
        Port({"model": "ODC2520"}),
        streams=True,
        takes_long=True,
    ),
    Profile("ascii-demo", "ascii", Wiring.both(("X",)), Port(ASCII_DEMO), unseen=_NO_READ_BACK),
    Profile(
        "ascii-sensor",
        "ascii",
        Wiring(("x",), ()),
        Port(ASCII_SENSOR),
        unseen=_NO_READ_BACK | {"A2", "B6", "B7", "S10"},
        streams=True,
    ),
    Profile(
        "psj-ddrive", "psj", Wiring((), ("ch0",)), Port({"profile": "ddrive"}), (), _NO_READ_BACK
    ),
    Profile(
        "psj-nv40",
        "psj",
        Wiring.both(("ch0",)),
        Port({"profile": "nv40", "remote": True}),
        unseen=_NO_READ_BACK,
        takes_long=True,
    ),
    Profile("psj-nv200", "psj", Wiring.both(("ch0",)), Port({"profile": "nv200"}), takes_long=True),
    Profile("psj-nv200-tcp", "psj", Wiring.both(("ch0",)), Tcp({"profile": "nv200"})),
    # Only where the compilers and simavr are: the emulated board is the compiled firmware.
    *(
        ()
        if missing()
        else (Profile("board", "piezo_board", Wiring.both(("1",)), Port({"watchdog_ms": 20_000})),)
    ),
)
