"""The checksum of HDF5's administrative data: Bob Jenkins' `lookup3`, function `hashlittle`.

`repair` needs it: the first bytes of a recording end with their checksum, which changes with them.
Neither Python nor h5py offers it.
"""

from typing import Final

_WORD: Final = 0xFFFFFFFF
_MIX: Final = ((0, 2, 1, 4), (1, 0, 2, 6), (2, 1, 0, 8), (0, 2, 1, 16), (1, 0, 2, 19), (2, 1, 0, 4))
_LAST: Final = ((2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24))


def lookup3(data: bytes) -> int:
    """Return the checksum of some bytes, an unsigned number of 32 bits."""
    state = [(0xDEADBEEF + len(data)) & _WORD] * 3
    # All blocks of 12 bytes but the last one are mixed; the last one, padded, is finished.
    last = max(0, (len(data) - 1) // 12 * 12)
    for start in range(0, last, 12):
        _add(state, data[start : start + 12])
        for target, other, next_, bits in _MIX:
            state[target] = (state[target] - state[other] & _WORD) ^ _rotated(state[other], bits)
            state[other] = state[other] + state[next_] & _WORD
    if not data:
        return state[2]
    _add(state, data[last:].ljust(12, b"\0"))
    for target, other, bits in _LAST:
        state[target] = (state[target] ^ state[other]) - _rotated(state[other], bits) & _WORD
    return state[2]


def _add(state: list[int], block: bytes) -> None:
    for place in range(3):
        word = int.from_bytes(block[4 * place : 4 * place + 4], "little")
        state[place] = state[place] + word & _WORD


def _rotated(word: int, bits: int) -> int:
    return (word << bits | word >> (32 - bits)) & _WORD
