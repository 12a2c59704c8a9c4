"""Makes what the boot loader of an RP2040 takes: `python3 image.py player.bin player.uf2`."""

import struct
import sys
import zlib
from pathlib import Path
from typing import Final

BOOT2: Final = 252
FLASH: Final = 0x10000000
PART: Final = 256
FAMILY: Final = 0xE48BFF56
HAS_FAMILY: Final = 0x2000


def crc_of_boot(code: bytes) -> int:
    """Return the CRC-32 that the boot ROM expects: most significant bit first, not inverted."""
    turned = bytes(int(f"{byte:08b}"[::-1], 2) for byte in code)
    return int(f"{zlib.crc32(turned) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def image_of(binary: bytes) -> bytes:
    """Return the image of a binary that begins with the second stage of the boot."""
    code = binary[:BOOT2]
    whole = code + struct.pack("<I", crc_of_boot(code)) + binary[PART:]
    parts = [whole[at : at + PART].ljust(PART, b"\0") for at in range(0, len(whole), PART)]
    head = [
        struct.pack(
            "<8I", 0x0A324655, 0x9E5D5157, HAS_FAMILY, FLASH + PART * i, PART, i, len(parts), FAMILY
        )
        for i in range(len(parts))
    ]
    return b"".join(
        before + part.ljust(476, b"\0") + struct.pack("<I", 0x0AB16F30)
        for before, part in zip(head, parts, strict=True)
    )


if __name__ == "__main__":
    Path(sys.argv[2]).write_bytes(image_of(Path(sys.argv[1]).read_bytes()))
