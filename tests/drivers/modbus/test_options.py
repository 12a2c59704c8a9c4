import pytest
from pydantic import ValidationError

from piezod_drivers.modbus.driver import channels_of
from piezod_drivers.modbus.options import ModbusOptions

T7 = {"profile": "labjack-t7", "host": "t7"}
TCP = {"host": "x"}
WATCHED = {"timeout_s": 2.0, "safe": 0.0}
ADAMS = ({"unit": 1, "profile": "adam-4024"}, {"unit": 2, "profile": "adam-6024"})
STATUS = {"role": "status", "address": 1, "flag": "busy"}
INPUT = {"role": "input", "channel": "a", "address": 0}
OUTPUT = {"role": "output", "channel": "a", "address": 0, "range": (0.0, 10.0), "scale": 1e-3}
BACK = {"role": "read-back", "channel": "a", "address": 0}


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"profile": "labjack-t7"}, "give either host"),
        ({**T7, "port": "/dev/x"}, "give either host"),
        (TCP, "give a profile, registers or units"),
        ({**T7, "profile": "labjack-u3"}, "unknown .got 'labjack-u3'., known: adam-4024"),
        ({**T7, "registers": (INPUT,)}, "leave out one of the two"),
        ({**T7, "units": ADAMS}, "leave out those outside"),
        ({**TCP, "units": ({"unit": 2},)}, "give a profile or registers"),
        ({**TCP, "units": (ADAMS[0], ADAMS[0])}, "same address"),
        ({**TCP, "units": ADAMS}, "outputs of the same name: AO0, AO1"),
        ({**TCP, "registers": (INPUT, INPUT)}, "inputs of the same name: a"),
        ({**TCP, "registers": (INPUT,), "write_functions": (23,)}, "6 or 16 is required"),
        ({**T7, "watchdog": WATCHED | {"timeout_s": 1.5}}, "whole seconds .got 1.5."),
        ({**T7, "watchdog": WATCHED | {"safe": 6.0}}, "allowed range 0 to 5 V"),
        ({**T7, "profile": "wago-750", "watchdog": WATCHED | {"safe": 1.0}}, "must be 0"),
        ({**T7, "profile": "adam-6024", "watchdog": WATCHED}, "cannot arm a watchdog"),
        ({**T7, "profile": "wago-750", "watchdog": WATCHED | {"timeout_s": 0.25}}, "tenths of a s"),
        ({"profile": "adam-4024", "port": "p", "unit": 0}, "line .got 0., allowed .* 1 to 255"),
        ({"units": ({"unit": 0, "profile": "adam-4024"},), "port": "p"}, "serial line .got 0."),
        ({**TCP, "registers": (INPUT, BACK)}, "needs an output, and no output is called 'a'"),
        ({**TCP, "registers": (OUTPUT, BACK | {"channel": "b"})}, "no output is called 'b'"),
        ({**TCP, "registers": (OUTPUT, STATUS | {"channel": "b"})}, "no input or output .* 'b'"),
    ],
)
def test_a_broken_rule_is_reported(options: dict[str, object], what: str) -> None:
    """Each mistake in the options is an error that names the allowed values."""
    with pytest.raises(ValidationError, match=what):
        ModbusOptions.model_validate(options)


@pytest.mark.parametrize(
    ("line", "unit"), [({"port": "p"}, 1), ({"port": "p"}, 255), (TCP, 0), (TCP, 255)]
)
def test_addresses_up_to_the_ends_are_taken(line: dict[str, object], unit: int) -> None:
    """A serial line has the addresses 1 to 255; over TCP 0 and 255 mean the device itself."""
    assert ModbusOptions.model_validate({**line, "profile": "wago-750", "unit": unit}).unit == unit


def test_a_status_may_be_about_an_input_or_an_output_or_all() -> None:
    """A status may concern an input, an output or the whole unit."""
    about = (STATUS | {"channel": "a"}, STATUS | {"channel": "b"}, STATUS)
    rows = (OUTPUT, BACK, INPUT | {"channel": "b"}, *about)
    assert len(ModbusOptions.model_validate({**TCP, "registers": rows}).registers) == 6


@pytest.mark.parametrize(
    ("row", "what"),
    [
        (INPUT | {"channel": None}, "give the channel a name"),
        (INPUT | {"table": "coil", "scale": 2.0}, "a bit is 0 or 1"),
        (INPUT | {"scale": 0.0}, "too small"),
        (INPUT | {"range": (1.0, 1.0)}, "must be above the first"),
        (INPUT | {"address": 65_535, "type": "int32"}, "two words does not fit there"),
        (OUTPUT | {"range": None}, "an output needs a range"),
        (OUTPUT | {"table": "input"}, "only holding registers"),
        (OUTPUT | {"scale": 1e-4}, "numbers 0 to 100000 do not fit into uint16"),
        (STATUS | {"flag": None}, "a status needs a flag"),
        (STATUS | {"type": "float32"}, "whole number"),
        (STATUS | {"flag": "tired"}, "flag"),
    ],
)
def test_a_senseless_register_is_reported(row: dict[str, object], what: str) -> None:
    """Each mistake in a register is an error that names the allowed values."""
    with pytest.raises(ValidationError, match=what):
        ModbusOptions.model_validate({**TCP, "registers": (row,)})


@pytest.mark.parametrize(
    ("options", "silence_s"),
    [
        ({"baud": 9600}, 3.5 * 10 / 9600),
        ({"baud": 9600, "parity": "E", "stop_bits": 2}, 3.5 * 12 / 9600),
        ({"baud": 115_200}, 1.75e-3),
        ({"silence_ms": 0.0}, 0.0),
    ],
)
def test_the_rest_of_the_line(options: dict[str, object], silence_s: float) -> None:
    """The silence is 3.5 characters up to 19200 bit/s, 1.75 ms above, or as configured."""
    found = ModbusOptions.model_validate({"profile": "adam-4024", "port": "/dev/x"} | options)
    assert found.silence_s == pytest.approx(silence_s)


def test_channels_have_the_units_of_their_registers() -> None:
    """A LabJack has inputs and outputs in V; a register has its configured unit."""
    units = channels_of(ModbusOptions.model_validate(T7))
    assert set(units.inputs) == {f"AIN{i}" for i in range(14)}
    assert units.outputs == {"DAC0": "V", "DAC1": "V"}
    rows = (INPUT | {"unit": "%"}, OUTPUT)
    assert channels_of(ModbusOptions.model_validate({"host": "x", "registers": rows})) == (
        {"a": "%"},
        {"a": "V"},
    )
