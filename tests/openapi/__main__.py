"""Sends to a simulated stage what schemathesis makes up from its OpenAPI document, for a minute.

`make schemathesis` runs it. It fails if an answer is an error of the server, or has a status, a
content type or a document that the description does not have. The same seed is used in each run.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from tests.daemon.daemons import Daemon, configuration
from tests.openapi.relay import relayed

HERE: Final = Path(__file__).parent
TOOL: Final = HERE.parents[1] / "build" / "schemathesis" / "bin" / "schemathesis"
SECONDS: Final = 60
SEED: Final = 29
PER_SECOND: Final = 40
"""The daemon admits 50 requests per second from one client."""


def main() -> int:
    """Run schemathesis against a stage; return its exit code."""
    with (
        TemporaryDirectory() as folder,
        Daemon(configuration(Path(folder), rate_hz="200")) as daemon,
    ):
        daemon.up()
        with relayed(daemon.paths.api_socket) as url:
            command = (
                *(TOOL, "--config-file", HERE / "schemathesis.toml", "run", f"{url}/v1/openapi"),
                *("--max-time", str(SECONDS), "--seed", str(SEED)),
                *("--rate-limit", f"{PER_SECOND}/s", "--generation-database", "none"),
            )
            code = subprocess.run(command, cwd=folder, check=False).returncode
        # Whatever was asked of it, it still runs, and stops.
        daemon.do("stop")
        daemon.signal(15)
        ended = daemon.exit_code()
        if code or ended:
            print(f"exit code of the daemon: {ended}; its log:\n{daemon.text[-4000:]}")
        return code or ended


if __name__ == "__main__":
    sys.exit(main())
