"""Which line a configuration leads to."""

from collections.abc import Mapping
from typing import Any

import pytest
from pydantic import ValidationError

from piezod.devices import registry
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.interface import Wiring
from tests.drivers.serial_line.ascii_rig import PLAIN

ON_EITHER: Mapping[str, Mapping[str, object]] = {
    "ascii": {key: value for key, value in PLAIN.items() if key != "port"},
    "pi_gcs2": {},
    "psj": {"profile": "nv200"},
}
"""Options, but for their line, of the drivers that speak over a serial port or over TCP."""


@pytest.mark.parametrize("driver", ON_EITHER)
@pytest.mark.parametrize(
    ("where", "what"),
    [
        ({}, "name either port"),
        ({"port": "p", "host": "h", "tcp_port": 23}, "name either port"),
        ({"host": "h"}, "host and tcp_port belong together"),
        ({"port": "p", "tcp_port": 23}, "host and tcp_port belong together"),
    ],
)
def test_a_device_has_one_line(driver: str, where: Mapping[str, object], what: str) -> None:
    """No line, two of them and half a one are errors, whatever else a driver checks."""
    with pytest.raises(ValidationError, match=what):
        registry.load(driver).options_model.model_validate({**ON_EITHER[driver], **where})


@pytest.mark.parametrize("driver", ["pi_gcs2", "psj"])
def test_everything_that_is_wrong_is_told_at_once(driver: str) -> None:
    """A range without a width is an error beside that of the line, and names its second value."""
    options = {**ON_EITHER[driver], "range_v": (5.0, 5.0)}

    with pytest.raises(ValidationError, match="must be above the first of the two") as caught:
        registry.load(driver).options_model.model_validate(options)
    assert [error["loc"] for error in caught.value.errors()] == [("port",), ("range_v", 1)]


@pytest.mark.parametrize(
    ("driver", "options", "wiring", "baud"),
    [
        ("psj", {"profile": "nv40"}, Wiring((), ("ch0",)), 19_200),
        ("psj", {"profile": "nv40", "baud": 57_600}, Wiring((), ("ch0",)), 57_600),
        ("micro_epsilon", {"model": "ILD1420"}, Wiring(("distance",), ()), 921_600),
        ("micro_epsilon", {"model": "ODC2520"}, Wiring(("distance",), ()), 115_200),
        ("micro_epsilon", {"model": "ODC2520", "baud": 9600}, Wiring(("distance",), ()), 9600),
        ("pi_gcs1", {"baud": 38_400}, Wiring.both("A"), 38_400),
    ],
)
def test_a_port_has_the_baud_rate_that_is_given_or_else_the_models(
    monkeypatch: pytest.MonkeyPatch,
    driver: str,
    options: Mapping[str, object],
    wiring: Wiring,
    baud: int,
) -> None:
    """The rate of a configuration comes first; who says nothing gets what the device has."""
    made: list[int] = []

    class Port(SerialLine):
        def __init__(self, port: str, baud: int, **more: Any) -> None:
            super().__init__(port, baud, **more)
            made.append(baud)

    monkeypatch.setattr("piezod_drivers.serial_line.options.SerialLine", Port)
    plugin = registry.load(driver)
    plugin.create(plugin.options_model.model_validate({"port": "p", **options}), wiring, 1)

    assert made == [baud]
