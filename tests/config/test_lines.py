"""Lines of the loop in the configuration of a stage."""

from pathlib import Path

import pytest

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.devices import registry
from piezod.errors import ConfigError
from tests.daemon.daemons import configuration

IO = """{driver: modbus, options: {host: localhost, registers: [
    {role: input, channel: DI0, table: discrete, address: 0},
    {role: output, channel: DO0, table: coil, address: 0}]}}"""


def loaded(folder: Path, lines: str) -> DaemonConfig:
    """Return a stage with an input and an output of a device."""
    path = configuration(folder, rig=f"{{driver: simulated}}\n  io: {IO}")
    with path.open("a", encoding="utf-8") as file:
        file.write(f"\nlines: {lines}\n")
    return load_daemon(path, registry)


def test_device_of_lines_alone_needs_no_axis(tmp_path: Path) -> None:
    """Its channels are those that the driver lists."""
    config = loaded(tmp_path, "{a: {device: io, input: DI0}, b: {device: io, output: DO0}}")

    assert [line.channel for line in config.lines.values()] == ["DI0", "DO0"]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("{a: {device: no, input: DI0}}", "no such device"),
        ("{a: {device: io, input: DO0}}", "no such input"),
        ("{a: {device: io, output: DI0}}", "no such output"),
        ("{a: {device: io}}", "either input"),
        ("{a: {device: io, input: DI0, output: DO0}}", "either input"),
        ("{a: {device: rig, output: x}, b: {device: io, input: DI0}}", "axis x drives"),
        ("{a: {device: io, output: DO0}, b: {device: io, output: DO0}}", "line a drives"),
    ],
)
def test_line_that_cannot_be_is_refused(tmp_path: Path, lines: str, words: str) -> None:
    """The error names the line and what it may be."""
    with pytest.raises(ConfigError, match=words):
        loaded(tmp_path, lines)
