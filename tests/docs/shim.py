"""`piezod` for the shell of a documented command: the test process runs it, see `command_server`.

To start Python with piezod takes longer than most commands. This program imports almost nothing: it
passes arguments, folder and streams to the test process, and returns the exit code.
"""

import json
import os
import socket
import sys

with socket.socket(socket.AF_UNIX) as connection:
    connection.connect(os.environ["PIEZOD_TEST_COMMANDS"])
    environ = {name: text for name, text in os.environ.items() if name.startswith("PIEZOD_")}
    folder = os.getcwd()  # noqa: PTH109 - pathlib takes too long
    request = {"arguments": sys.argv[1:], "folder": folder, "environ": environ}
    socket.send_fds(connection, [json.dumps(request).encode()], [0, 1, 2])
    sys.exit(int(connection.recv(16) or 1))
