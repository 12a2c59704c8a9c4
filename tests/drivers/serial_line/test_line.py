"""The line of a configuration."""

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
"""Options, without their line, of the drivers for a serial port or TCP."""


@pytest.mark.parametrize("driver", ON_EITHER)
@pytest.mark.parametrize(
    ("where", "what"),
    [
        ({}, "give either port"),
        ({"port": "p", "host": "h", "tcp_port": 23}, "give either port"),
        ({"host": "h"}, "give both host and tcp_port"),
        ({"port": "p", "tcp_port": 23}, "give both host and tcp_port"),
    ],
)
def test_a_device_has_one_line(driver: str, where: Mapping[str, object], what: str) -> None:
    """No line, two lines or half a line are errors, besides those that a driver checks."""
    with pytest.raises(ValidationError, match=what):
        registry.load(driver).options_model.model_validate({**ON_EITHER[driver], **where})


@pytest.mark.parametrize("driver", ["pi_gcs2", "psj"])
def test_all_mistakes_are_reported_together(driver: str) -> None:
    """A range without width is an error besides that of the line, at its second value."""
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
    """A configured bit rate replaces that of the model."""
    made: list[int] = []

    class Port(SerialLine):
        def __init__(self, port: str, baud: int, **more: Any) -> None:
            super().__init__(port, baud, **more)
            made.append(baud)

    monkeypatch.setattr("piezod_drivers.serial_line.options.SerialLine", Port)
    plugin = registry.load(driver)
    plugin.create(plugin.options_model.model_validate({"port": "p", **options}), wiring, 1)

    assert made == [baud]
