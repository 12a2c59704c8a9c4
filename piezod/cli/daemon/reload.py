"""`piezod reload`: the daemon reads its configuration again."""

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import SocketOption, StageOption, connect, print_answer


def reload(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Reload the configuration; print what has changed, and what has been lost."""
    with connect(stage, socket) as client:
        answer = client.reload()
    changes = f"changed: {', '.join(answer.changes)}" if answer.changes else "nothing has changed"
    lost = [f"lost: {what}" for what in answer.lost]
    text = f"the configuration has been read again, {changes}"
    print_answer(answer, "\n".join((text, *lost)), json=json)
