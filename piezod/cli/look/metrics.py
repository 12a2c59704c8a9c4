"""`piezod metrics`: the metrics of a stage, for Prometheus."""

import sys
from contextlib import closing

from piezod.cli.stage_options import SocketOption, StageOption, connect


def metrics(stage: StageOption = None, socket: SocketOption = None) -> None:
    """Print the metrics."""
    with closing(connect(stage, socket)) as client:
        text = client.metrics()
    sys.stdout.write(text)
    sys.stdout.flush()  # so that a full disk is an error with an exit code
