"""`piezod reload`: the daemon reads its configuration again."""

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import SocketOption, StageOption, connect, print_answer


def reload(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Reload the configuration."""
    with connect(stage, socket) as client:
        answer = client.reload()
    print_answer(answer, "the configuration has been read again", json=json)
