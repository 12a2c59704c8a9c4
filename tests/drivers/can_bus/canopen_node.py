"""A node of the canopen library in a process of its own; each input shows half of the output.

The library answers SDO, obeys NMT and sends heartbeats. Its user has to give process data a meaning
and to send them.

Usage: python canopen_node.py GROUP PORT [sizeless]; ends when its standard input ends. With
"sizeless" its SDO replies leave out the size of an object, as CiA 301 allows.
"""

import sys
from typing import Any

import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

from piezod_drivers.can_bus.cia401.emulation.object_dictionary import Entry, object_dictionary

NODE = 5
TYPES = {
    (1, False): datatypes.UNSIGNED8,
    (2, False): datatypes.UNSIGNED16,
    (4, False): datatypes.UNSIGNED32,
    (2, True): datatypes.INTEGER16,
    (4, True): datatypes.INTEGER32,
    (0, False): datatypes.VISIBLE_STRING,
}


def library_dictionary() -> Any:
    """Return the objects of our emulated node as objects of the library."""
    found: Any = canopen.ObjectDictionary()  # type: ignore[no-untyped-call] # the library's
    groups: dict[int, Any] = {}
    for (index, number), entry in object_dictionary(NODE).items():
        variable = _variable(index, number, entry)
        if (index, 1) not in object_dictionary(NODE):
            found.add_object(variable)
            continue
        if index not in groups:
            kind: Any = ODArray if index >= 0x6000 else ODRecord
            groups[index] = kind(f"{entry.name} {index:X}", index)
            found.add_object(groups[index])
        groups[index].add_member(variable)
    return found


def _variable(index: int, number: int, entry: Entry) -> Any:
    kind: Any = ODVariable
    variable = kind(f"{entry.name} {index:X} {number}", index, number)
    variable.data_type = TYPES[entry.n_bytes, entry.is_signed]
    variable.access_type = entry.access
    variable.default = variable.value = entry.value
    variable.pdo_mappable = bool(entry.mapping)
    return variable


class Device:
    """The node and the meaning of its process data.

    Args:
        network: The network that it is on.
    """

    def __init__(self, network: Any) -> None:
        self._network = network
        self._node = network.create_node(NODE, library_dictionary())
        network.subscribe(0x300 + NODE, self._set_outputs)
        network.subscribe(0x080, self._send_inputs)
        self._node.nmt.send_command(0)  # boot-up, then pre-operational

    def leave_sizes_out(self) -> None:
        """Say of no object how many bytes of a reply are its own."""
        send = self._node.sdo.send_response

        def send_sizeless(reply: bytearray) -> None:
            if reply[0] & 0xE2 == 0x42:
                n_bytes = 4 - (reply[0] >> 2 & 3)
                reply[0], reply[4 + n_bytes :] = 0x42, b"\xaa" * (4 - n_bytes)
            send(reply)

        self._node.sdo.send_response = send_sizeless

    def _mapping(self, index: int) -> list[tuple[int, int]]:
        count = self._number(index, 0)
        entries = [self._number(index, i + 1) for i in range(count)]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def _number(self, index: int, number: int) -> int:
        return int.from_bytes(self._node.get_data(index, number), "little")

    def _set_outputs(self, _id: int, data: bytearray, _stamp: float) -> None:
        for i, (index, number) in enumerate(self._mapping(0x1601)):
            word = bytes(data[2 * i : 2 * i + 2])
            self._node.set_data(index, number, word)
            half = int.from_bytes(word, "little", signed=True) // 2
            self._node.set_data(0x6401, number, half.to_bytes(2, "little", signed=True))

    def _send_inputs(self, _id: int, _data: bytearray, _stamp: float) -> None:
        if self._node.nmt.state == "OPERATIONAL":
            words = [self._node.get_data(*place) for place in self._mapping(0x1A01)]
            self._network.send_message(0x280 + NODE, b"".join(words))


def main() -> None:
    """Run the node until standard input ends."""
    network = canopen.Network()
    group, port, *ways = sys.argv[1:]
    network.connect(interface="udp_multicast", channel=group, port=int(port), hop_limit=0, fd=False)
    device = Device(network)
    if "sizeless" in ways:
        device.leave_sizes_out()
    print("ready", flush=True)
    sys.stdin.read()
    network.disconnect()


if __name__ == "__main__":
    main()
