"""Rules that concern several options of a device that speaks in lines of text."""

import re
from collections.abc import Collection, Iterator, Sequence
from typing import Final

from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule
from piezod_drivers.serial_line.ascii_line.fields import AsciiFields, AskConfig
from piezod_drivers.serial_line.ascii_line.templates import TAG, names_of, parsed

IDENTITY: Final = ("maker", "model", "serial", "firmware")
_NONE: Final[Collection[str]] = ()


def broken_rules(options: AsciiFields) -> Iterator[BrokenRule]:
    """Yield the broken rules."""
    if not options.inputs and not options.outputs:
        yield ("outputs",), "give a channel, here or in inputs"
    for name, output in options.outputs.items():
        if not output.lowest < output.highest:
            yield ("outputs", name, "highest"), "must be above lowest"
    if TAG in options.inputs or TAG in options.outputs:
        yield ("outputs",), f"{TAG} cannot be a channel: it is the running number"
    yield from _lists(options)
    yield from _stream(options)
    if any(ask.reply is None for ask in options.set) and not options.read_back:
        what = "a setpoint without reply is not confirmed: also give read_back"
        yield ("set",), what
    if options.identify is not None:
        yield from _ask(("identify",), options.identify, options, _NONE, IDENTITY)
        if options.identify.reply is None:
            yield ("identify", "reply"), "required: a pattern for the reply of the device"
    if options.status is not None:
        yield from _sent(("status", "send"), options.status.send, options, _NONE)


def _lists(options: AsciiFields) -> Iterator[BrokenRule]:
    for place, asks in (("start", options.start), ("stop", options.stop)):
        for index, ask in enumerate(asks):
            yield from _ask((place, index), ask, options, _NONE, _NONE)
    for index, ask in enumerate(options.set):
        yield from _ask(("set", index), ask, options, options.outputs, _NONE)
    yield from _each_once("set", [names_of(ask.send) for ask in options.set], options.outputs)
    for place, asks, channels in (
        ("read", options.read, options.inputs),
        ("read_back", options.read_back, options.outputs),
    ):
        for index, ask in enumerate(asks):
            yield from _ask((place, index), ask, options, _NONE, channels)
        # Reading back is optional, unless setpoints have no reply.
        if place == "read_back" and not asks:
            continue
        if place == "read" and options.stream is not None:
            continue
        yield from _each_once(place, [_groups(ask.reply) for ask in asks], channels)


def _stream(options: AsciiFields) -> Iterator[BrokenRule]:
    if options.stream is None:
        return
    if options.read or options.outputs or options.identify or options.status:
        what = "a stream is only read: leave out read, outputs, identify, status"
        yield ("stream",), what
    groups = _groups(options.stream)
    yield from _unknown(("stream",), groups, options.inputs)
    yield from _each_once("stream", [groups], options.inputs)


def _ask(
    path: KeyPath,
    ask: AskConfig,
    options: AsciiFields,
    values: Collection[str],
    groups: Collection[str],
) -> Iterator[BrokenRule]:
    """Check a command and its reply.

    Args:
        path: Key of the command.
        ask: The command.
        options: All options.
        values: Channels whose values it may send.
        groups: Groups that its reply may have.
    """
    yield from _sent((*path, "send"), ask.send, options, values)
    groups_found = _groups(ask.reply)
    yield from _unknown((*path, "reply"), groups_found, [*groups, TAG])
    # A number in only one of them cannot relate a reply to its command.
    if (TAG in groups_found) != (TAG in names_of(ask.send)):
        what = f"give both {{{TAG}}} in send and (?P<{TAG}>…) in reply"
        yield (*path, "reply"), what


def _sent(
    path: KeyPath, template: str, options: AsciiFields, values: Collection[str]
) -> Iterator[BrokenRule]:
    yield from _unknown(path, names_of(template), [*values, TAG])
    # The values themselves are ASCII digits, which every encoding has.
    text = "".join(place.before for place in parsed(template))
    if options.terminator in text:
        yield path, "must not contain the terminator, which is added"
    try:
        text.encode(options.encoding)
    except UnicodeEncodeError:
        yield path, f"has characters that the encoding {options.encoding} lacks"


def _unknown(path: KeyPath, names: Sequence[str], known: Collection[str]) -> Iterator[BrokenRule]:
    for name in names:
        if name not in known:
            yield path, f"unknown channel or group (got {name}), known: {', '.join(known)}"


def _each_once(
    place: str, named: Sequence[Sequence[str]], channels: Collection[str]
) -> Iterator[BrokenRule]:
    all_names = [name for names in named for name in names if name != TAG]
    for index, names in enumerate(named):
        if not set(names) - {TAG}:
            yield (place, index), "has no channel"
    for channel in channels:
        if (count := all_names.count(channel)) != 1:
            how = "0 times" if count == 0 else f"{count} times"
            yield (place,), f"channel {channel} must occur once (it occurs {how})"


def _groups(pattern: str | None) -> list[str]:
    return [] if pattern is None else list(re.compile(pattern).groupindex)
