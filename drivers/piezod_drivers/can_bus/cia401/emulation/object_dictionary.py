"""Object dictionary of the emulated CiA 401 node, with four inputs and outputs of ±10 V."""

from typing import Final, Literal, NamedTuple

Access = Literal["ro", "rw"]
"""Read-only, or readable and writable."""

N_CHANNELS: Final = 4
VENDOR: Final = 0x0000_0000
PRODUCT: Final = 0x401
REVISION: Final = 0x0001_0000
SERIAL: Final = 1
_TPDO_ID: Final = 0x4000_0000
"""Bit in the identifier of a TPDO: a remote frame cannot request it."""


class Entry(NamedTuple):
    """An object of a node."""

    name: str  #: Name as in an EDS file.
    n_bytes: int  #: Length; 0 for a text.
    value: int | str  #: Value after power-up.
    access: Access = "ro"  #: Whether it can be written.
    is_signed: bool = False  #: Whether the value is signed.
    #: Kind of PDO that it can be mapped into; "" for none.
    mapping: Literal["", "rpdo", "tpdo", "both"] = ""


def object_dictionary(node: int, serial: int = SERIAL) -> dict[tuple[int, int], Entry]:
    """Return the objects of a node by index and sub-index.

    Args:
        node: Node number, which is part of identifiers.
        serial: Serial number.
    """
    entries = {
        (0x1000, 0): Entry("Device type", 4, 0x000C_0191),  # analogue inputs and outputs
        (0x1001, 0): Entry("Error register", 1, 0, mapping="tpdo"),
        (0x1005, 0): Entry("COB-ID SYNC", 4, 0x80, "rw"),
        (0x1008, 0): Entry("Manufacturer device name", 0, "piezod canopen-401"),
        (0x100A, 0): Entry("Manufacturer software version", 0, "1.0"),
        (0x1014, 0): Entry("COB-ID EMCY", 4, 0x80 + node),
        (0x1016, 0): Entry("Consumer heartbeat time", 1, 1),
        (0x1016, 1): Entry("Consumer heartbeat time 1", 4, 0, "rw"),
        (0x1017, 0): Entry("Producer heartbeat time", 2, 0, "rw"),
        (0x1018, 0): Entry("Identity object", 1, 4),
        (0x1018, 1): Entry("Vendor-ID", 4, VENDOR),
        (0x1018, 2): Entry("Product code", 4, PRODUCT),
        (0x1018, 3): Entry("Revision number", 4, REVISION),
        (0x1018, 4): Entry("Serial number", 4, serial),
        (0x1029, 0): Entry("Error behaviour", 1, 1),
        (0x1029, 1): Entry("Communication error", 1, 0, "rw"),
    }
    # CiA 401 maps analogue values into the second PDO; the first one is for digital values.
    entries |= _pdo(0x1401, 0x1601, 0x300 + node, 0x6411)
    entries |= _pdo(0x1801, 0x1A01, _TPDO_ID | (0x280 + node), 0x6401)
    entries |= _array(0x6401, "Read analogue input 16-bit", Entry("AI", 2, 0, "ro", True, "tpdo"))
    output = Entry("AO", 2, 0, "rw", True, "both")
    entries |= _array(0x6411, "Write analogue output 16-bit", output)
    entries |= _array(0x6443, "Analogue output error mode", Entry("Mode", 1, 0, "rw"))
    # Four bytes; some nodes have two.
    error_value = Entry("Value", 4, 0, "rw", True)
    entries |= _array(0x6444, "Analogue output error value integer", error_value)
    return entries


def _pdo(settings: int, mapping: int, identifier: int, index: int) -> dict[tuple[int, int], Entry]:
    entries = {
        (settings, 0): Entry("PDO communication parameter", 1, 2),
        (settings, 1): Entry("COB-ID", 4, identifier, "rw"),
        (settings, 2): Entry("Transmission type", 1, 255, "rw"),
        (mapping, 0): Entry("PDO mapping parameter", 1, N_CHANNELS, "rw"),
    }
    for i in range(1, N_CHANNELS + 1):
        entries[mapping, i] = Entry(f"Mapping entry {i}", 4, index << 16 | i << 8 | 16, "rw")
    return entries


def _array(index: int, name: str, each: Entry) -> dict[tuple[int, int], Entry]:
    entries = {(index, 0): Entry(name, 1, N_CHANNELS)}
    for i in range(1, N_CHANNELS + 1):
        entries[index, i] = each._replace(name=f"{each.name} {i}")
    return entries
