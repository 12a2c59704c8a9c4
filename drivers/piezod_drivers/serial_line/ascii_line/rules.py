"""What of the options of a device that speaks in lines must fit together."""

import re
from collections.abc import Collection, Iterator, Sequence
from typing import Final

from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule
from piezod_drivers.serial_line.ascii_line.fields import AsciiFields, AskConfig
from piezod_drivers.serial_line.ascii_line.templates import TAG, names_of, parsed

IDENTITY: Final = ("maker", "model", "serial", "firmware")
_NOBODY: Final[Collection[str]] = ()


def broken_rules(options: AsciiFields) -> Iterator[BrokenRule]:
    """Find everything that does not fit together."""
    if not options.inputs and not options.outputs:
        yield ("outputs",), "name a channel, here or in inputs"
    for name, output in options.outputs.items():
        if not output.lowest < output.highest:
            yield ("outputs", name, "highest"), "must be above lowest"
    if TAG in options.inputs or TAG in options.outputs:
        yield ("outputs",), f"{TAG} cannot be a channel, it is the number that goes round"
    yield from _lists(options)
    yield from _stream(options)
    if any(ask.reply is None for ask in options.set) and not options.read_back:
        what = "a setpoint that is not answered is not known to be taken: give read_back too"
        yield ("set",), what
    if options.identify is not None:
        yield from _ask(("identify",), options.identify, options, _NOBODY, IDENTITY)
        if options.identify.reply is None:
            yield ("identify", "reply"), "needed: a pattern for what the device answers"
    if options.status is not None:
        yield from _sent(("status", "send"), options.status.send, options, _NOBODY)


def _lists(options: AsciiFields) -> Iterator[BrokenRule]:
    for place, asks in (("start", options.start), ("stop", options.stop)):
        for index, ask in enumerate(asks):
            yield from _ask((place, index), ask, options, _NOBODY, _NOBODY)
    for index, ask in enumerate(options.set):
        yield from _ask(("set", index), ask, options, options.outputs, _NOBODY)
    yield from _each_once("set", [names_of(ask.send) for ask in options.set], options.outputs)
    for place, asks, channels in (
        ("read", options.read, options.inputs),
        ("read_back", options.read_back, options.outputs),
    ):
        for index, ask in enumerate(asks):
            yield from _ask((place, index), ask, options, _NOBODY, channels)
        if place == "read_back" and not asks:
            continue
        if place == "read" and options.stream is not None:
            continue
        yield from _each_once(place, [_groups(ask.reply) for ask in asks], channels)


def _stream(options: AsciiFields) -> Iterator[BrokenRule]:
    if options.stream is None:
        return
    if options.read or options.outputs or options.identify or options.status:
        what = "a device that sends unasked is not asked: leave out read, outputs, identify, status"
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
    """Check a command and its answer.

    Args:
        path: Where it stands.
        ask: The command.
        options: All options.
        values: Whose values it may send.
        groups: Whose values its answer may tell.
    """
    yield from _sent((*path, "send"), ask.send, options, values)
    told = _groups(ask.reply)
    yield from _unknown((*path, "reply"), told, [*groups, TAG])
    if (TAG in told) != (TAG in names_of(ask.send)):
        what = f"{{{TAG}}} in send and (?P<{TAG}>…) in reply belong together"
        yield (*path, "reply"), what


def _sent(
    path: KeyPath, template: str, options: AsciiFields, values: Collection[str]
) -> Iterator[BrokenRule]:
    yield from _unknown(path, names_of(template), [*values, TAG])
    text = "".join(place.before for place in parsed(template))
    if options.terminator in text:
        yield path, "must not hold the terminator, which is added"
    try:
        text.encode(options.encoding)
    except UnicodeEncodeError:
        yield path, f"has characters that are not in encoding {options.encoding}"


def _unknown(path: KeyPath, names: Sequence[str], known: Collection[str]) -> Iterator[BrokenRule]:
    for name in names:
        if name not in known:
            yield path, f"no such channel or group here (got {name}), known: {', '.join(known)}"


def _each_once(
    place: str, named: Sequence[Sequence[str]], channels: Collection[str]
) -> Iterator[BrokenRule]:
    all_names = [name for names in named for name in names if name != TAG]
    for index, names in enumerate(named):
        if not set(names) - {TAG}:
            yield (place, index), "names no channel"
    for channel in channels:
        if (count := all_names.count(channel)) != 1:
            how = "nowhere" if count == 0 else f"{count} times"
            yield (place,), f"channel {channel} must stand here once (it stands here {how})"


def _groups(pattern: str | None) -> list[str]:
    return [] if pattern is None else list(re.compile(pattern).groupindex)
