"""`piezod stream`: setpoints of another program, from stdin."""

import json as json_text
import sys
from collections.abc import Iterable, Iterator

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import SocketOption, StageOption, connect, print_answer
from piezod.errors import DataError


def stream(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Send the setpoints of stdin and print their number."""
    with connect(stage, socket) as client:
        ended = client.stream(_setpoints(sys.stdin))
    print_answer(ended, f"{ended.setpoints} setpoints followed, the stage holds", json=json)


def _setpoints(lines: Iterable[str]) -> Iterator[dict[str, float]]:
    for number, line in enumerate(lines, start=1):
        if line.strip():
            yield _setpoint(line, number)


def _setpoint(line: str, number: int) -> dict[str, float]:
    try:
        setpoint = json_text.loads(line)
    except ValueError:
        setpoint = None
    if (
        not isinstance(setpoint, dict)
        or not setpoint
        or not all(map(_is_number, setpoint.values()))
    ):
        what = f'stdin:{number}: must be positions by axis, for example {{"x": 12.3}}'
        raise DataError(f"{what} (got {line.strip()[:40]})")
    return setpoint


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
