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
    request = json.dumps({"arguments": sys.argv[1:], "folder": os.getcwd()})  # noqa: PTH109 - pathlib takes too long
    socket.send_fds(connection, [request.encode()], [0, 1, 2])
    sys.exit(int(connection.recv(16) or 1))
