"""Signals of DBC files by canmatrix."""

import json
from pathlib import Path
from random import Random

import pytest

from piezod_drivers.can_bus.dbc.codec import SignalReader, SignalWriter
from piezod_drivers.can_bus.dbc.database import load
from tests.peers.peer import run_peer

pytestmark = pytest.mark.peers

N_SIGNALS = 400


def _signal(random: Random) -> str:
    """Return a line of a DBC file with any signal that fits into eight bytes."""
    bits, is_big, sign = random.randint(1, 64), random.random() < 0.5, random.choice("+-")
    low = random.randint(0, 64 - bits)
    # A DBC file numbers the bits of a big-endian signal from its highest bit downwards.
    start = low // 8 * 8 + 7 - low % 8 if is_big else low
    return f' SG_ S : {start}|{bits}@{0 if is_big else 1}{sign} (1,0) [0|0] "" Host'


@pytest.mark.confirms(
    "can_dbc", "can_dbc", part="DBC files, bits of signals", by="canmatrix", kind="client"
)
def test_canmatrix_reads_and_writes_the_same_bits(tmp_path: Path) -> None:
    """Random signals of a DBC file have the same number and the same bytes in both programs."""
    random = Random(1)  # noqa: S311 - not for secrets
    names = [f"M{i}" for i in range(N_SIGNALS)]
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: Host Node"]
    for i, name in enumerate(names):
        lines += ["", f"BO_ {i + 1} {name}: 8 Node", _signal(random)]
    path = tmp_path / "random.dbc"
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    messages = load(path)
    data = {name: random.randbytes(8) for name in names}
    values = {name: random.randint(*messages[name].signals["S"].raw_range) for name in names}
    written = {name: bytearray(8) for name in names}
    for name in names:
        SignalWriter(messages[name], "S").put_raw(written[name], values[name])

    theirs = run_peer(
        "canmatrix_client.py",
        str(path),
        json.dumps({name: each.hex() for name, each in data.items()}),
        json.dumps(values),
    )

    assert theirs["read"] == {n: SignalReader(messages[n], "S").raw(data[n]) for n in names}
    assert theirs["written"] == {name: bytes(each).hex() for name, each in written.items()}
