"""Options of a device that speaks in lines, and errors in them."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.ascii_line.codec import AsciiLines, number
from piezod_drivers.serial_line.ascii_line.driver import PLUGIN
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.ascii_line.templates import fill, parsed
from tests.drivers.serial_line.ascii_rig import LISTENED, PLAIN


def errors_of(options: dict[str, Any]) -> str:
    """Return the error text of wrong options."""
    with pytest.raises(ValidationError) as caught:
        AsciiOptions.model_validate(options)
    return "\n".join(f"{error['loc']}: {error['msg']}" for error in caught.value.errors())


@pytest.mark.parametrize(
    ("changed", "place", "what"),
    [
        ({"set": ({"send": "V {y}", "reply": "OK"},)}, "'set', 0, 'send'", "unknown channel"),
        ({"set": ({"send": "V", "reply": "OK"},)}, "'set', 0", "has no channel"),
        ({"set": ()}, "'set',", "channel x must occur once (it occurs 0 times)"),
        ({"set": ({"send": "V {x}", "reply": "OK"},) * 2}, "'set',", "2 times"),
        ({"set": ({"send": "V {x}"},)}, "'set',", "also give read_back"),
        ({"set": ({"send": "V {x}\n", "reply": "OK"},)}, "'set', 0, 'send'", "terminator"),
        ({"set": ({"send": "V {x} µ", "reply": "OK"},)}, "'set', 0, 'send'", "encoding ascii"),
        ({"set": ({"send": "V {x.real}", "reply": "OK"},)}, "'set', 0, 'send'", "no channel"),
        ({"set": ({"send": "V {x!r}", "reply": "OK"},)}, "'set', 0, 'send'", "{x:.3f}"),
        ({"set": ({"send": "V {x:999d}", "reply": "OK"},)}, "'set', 0, 'send'", "{x:.3f}"),
        (
            {"set": ({"send": "{n} {x}", "reply": "OK"},)},
            "'set', 0, 'reply'",
            "give both {n} in send",
        ),
        (
            {"set": ({"send": "{x}", "reply": "(?P<n>.) O"},)},
            "'set', 0, 'reply'",
            "give both {n} in send",
        ),
        ({"set": ({"send": "{n:5} {x}", "reply": "(?P<n>.)"},)}, "'set', 0, 'send'", "{n:03d}"),
        ({"set": ({"send": "V {x", "reply": "OK"},)}, "'set', 0, 'send'", "expected '}'"),
        (
            {"read": ({"send": "P?", "reply": r"(?P<y>\d+)"},)},
            "'read', 0, 'reply'",
            "unknown channel or group",
        ),
        ({"read": ({"send": "P?", "reply": "(a+)+"},)}, "'read', 0, 'reply'", "so is the group"),
        ({"read": ()}, "'read',", "channel x must occur once"),
        (
            {"read": ({"send": "P {x}", "reply": r"(?P<x>\d+)"},)},
            "'read', 0, 'send'",
            "unknown channel or group",
        ),
        (
            {"identify": {"send": "?", "reply": "(?P<who>.*)"}},
            "'identify', 'reply'",
            "unknown channel or group",
        ),
        ({"identify": {"send": "?"}}, "'identify', 'reply'", "required: a pattern"),
        ({"errors": ({"pattern": "(", "flag": "busy"},)}, "'pattern'", "no regular expression"),
        ({"errors": ({"pattern": "E", "flag": "tired"},)}, "'flag'", "Input should be"),
        ({"outputs": {"x": {"lowest": 1.0, "highest": 1.0}}}, "'highest'", "above lowest"),
        ({"outputs": {"a-b": {"lowest": 0.0, "highest": 1.0}}}, "'outputs'", "match pattern"),
        ({"inputs": {}, "outputs": {}, "set": (), "read": ()}, "'outputs',", "give a channel"),
        ({"inputs": {"n": {}}}, "'outputs',", "the running number"),
        ({"stream": r"(?P<x>\d+)"}, "'stream',", "leave out read, outputs"),
        ({"longest_reply": 251}, "'longest_reply',", "1 to 250 bytes"),
        (
            {"status": {"send": "{x}", "flags": ({"pattern": "E", "flag": "busy"},)}},
            "",
            "unknown channel or group",
        ),
    ],
)
def test_contradictory_options_are_reported_with_their_place(
    changed: dict[str, Any], place: str, what: str
) -> None:
    """Every mistake in commands and patterns is found in the configuration, with its place."""
    errors = errors_of({**PLAIN, **changed})

    assert place in errors
    assert what in errors


@pytest.mark.parametrize("options", [PLAIN, LISTENED])
def test_channels_and_units_are_those_of_the_options(options: dict[str, Any]) -> None:
    """Channels and units of the driver are those of the options."""
    model = AsciiOptions.model_validate(dict(options))

    units = PLUGIN.channels(model)

    assert units is not None
    assert list(units.inputs) == list(model.inputs)
    assert list(units.outputs) == list(model.outputs)


@given(st.floats(-1e9, 1e9), st.integers(0, 999))
def test_values_are_written_in_their_format(value: float, tag: int) -> None:
    """Values in a command have Python's format."""
    places = parsed("{n:03d} V{{{x:.3f}}} {x}")

    assert fill(places, {"x": value, "n": tag}) == f"{tag:03d} V{{{value:.3f}}} {value:.4f}"


@given(st.text(max_size=40))
def test_any_text_is_a_command_or_refused(text: str) -> None:
    """Any text is a valid command or raises the documented error."""
    try:
        places = parsed(text)
    except ValueError:
        return
    fill(places, {place.name: 1.0 if place.name != "n" else 1 for place in places})


@given(
    st.binary(max_size=400)
    | st.lists(st.sampled_from([b"\r", b"\n", b"\xff", b"1.5"])).map(b"".join),
    st.sampled_from(["ascii", "latin-1", "utf-8"]),
    st.sampled_from(["\n", "\r\n", ">"]),
)
def test_any_bytes_are_lines_or_garbage_or_not_enough(got: bytes, code: str, ending: str) -> None:
    """Any bytes raise only faults of the line and never make the codec wait for ever."""
    lines = AsciiLines(
        AsciiOptions.model_validate({**PLAIN, "encoding": code, "reply_terminator": ending})
    )
    while length := lines.length(got):
        assert abs(length) <= len(got)
        if length > 0:
            try:
                number(lines.text(got[:length]))
            except LineFault as fault:
                assert fault.flag is DeviceFlag.GARBAGE
        got = got[abs(length) :]
    assert len(got) <= 120 + len(ending)


@pytest.mark.parametrize(("text", "value"), [("-1.5e3", -1500.0), (" +.5 ", 0.5), ("7.", 7.0)])
def test_numbers_are_read_as_devices_write_them(text: str, value: float) -> None:
    """Signs, points and exponents are read."""
    assert number(text) == value
