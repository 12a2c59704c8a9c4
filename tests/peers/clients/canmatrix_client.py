"""Signals of a DBC file by canmatrix: python canmatrix_client.py FILE DATA VALUES.

DATA has the bytes of each message in hex, VALUES the number of its signal, both in JSON by the name
of the message. Prints in JSON the numbers that canmatrix reads, and the bytes that it writes.
"""

import json
import sys

import canmatrix.formats


def main() -> None:
    """Read and write each message."""
    path, data, values = sys.argv[1:]
    matrix = canmatrix.formats.loadp_flat(path)
    frames = {frame.name: frame for frame in matrix.frames}
    read = {
        name: int(frames[name].decode(bytes.fromhex(text))["S"].raw_value)
        for name, text in json.loads(data).items()
    }
    written = {
        name: frames[name].encode({"S": value}).hex() for name, value in json.loads(values).items()
    }
    print(json.dumps({"read": read, "written": written}))


if __name__ == "__main__":
    main()
