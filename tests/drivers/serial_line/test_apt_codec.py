"""Messages of the APT protocol agree with thorlabs-apt-protocol and survive garbage."""

from collections.abc import Callable
from typing import Any

import pytest
import thorlabs_apt_protocol as peer
from hypothesis import given
from hypothesis import strategies as st

from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import HOST, UNIT, AptFrameError, Hardware, Id

COUNTS = st.integers(-32768, 32767)
CHANNEL = 1

SENT = [
    (peer.hw_req_info(UNIT, HOST), codec.short(Id.REQ_INFO)),
    (peer.hw_no_flash_programming(UNIT, HOST), codec.short(Id.NO_FLASH_PROGRAMMING)),
    (peer.hw_start_updatemsgs(UNIT, HOST), codec.short(Id.START_UPDATES)),
    (peer.hw_stop_updatemsgs(UNIT, HOST), codec.short(Id.STOP_UPDATES)),
    (peer.mod_set_chanenablestate(UNIT, HOST, 1, 1), codec.short(Id.SET_ENABLED, 1, 1)),
    (peer.mod_req_chanenablestate(UNIT, HOST, 1), codec.short(Id.REQ_ENABLED, 1)),
    (peer.pz_set_positioncontrolmode(UNIT, HOST, 1, 3), codec.short(Id.SET_CONTROL_MODE, 1, 3)),
    (peer.pz_req_positioncontrolmode(UNIT, HOST, 1), codec.short(Id.REQ_CONTROL_MODE, 1)),
    (peer.pz_req_outputvolts(UNIT, HOST, 1), codec.short(Id.REQ_OUTPUT, 1)),
    (
        peer.pz_set_inputvoltssrc(UNIT, HOST, 1, 0),
        codec.long(Id.SET_SOURCE, codec.words(1, 0)),
    ),
    (peer.pz_req_inputvoltssrc(UNIT, HOST, 1), codec.short(Id.REQ_SOURCE, 1)),
    (peer.pz_req_pzstatusupdate(UNIT, HOST, 1), codec.short(Id.REQ_STATUS, 1)),
    (peer.pz_ack_pzstatusupdate(UNIT, HOST), codec.short(Id.ACK_STATUS)),
    (peer.pz_req_maxtravel(UNIT, HOST, 1), codec.short(Id.REQ_MAX_TRAVEL, 1)),
    (peer.pz_req_tpz_iosettings(UNIT, HOST, 1), codec.short(Id.REQ_IO, 1)),
]


@pytest.mark.confirms(
    "thorlabs_apt",
    ("KPZ101", "TPZ001"),
    part="requests and settings, byte by byte",
    by="thorlabs-apt-protocol",
    kind="client",
)
@pytest.mark.parametrize(("theirs", "ours"), SENT)
def test_messages_are_those_of_another_reading(theirs: bytes, ours: bytes) -> None:
    """Every request and setting of the drivers equals that of thorlabs-apt-protocol."""
    assert ours == theirs


@given(COUNTS)
def test_voltage_is_set_as_by_another_reading(counts: int) -> None:
    """A voltage is packed as thorlabs-apt-protocol packs it."""
    ours = codec.long(Id.SET_OUTPUT, codec.words(CHANNEL, counts))
    assert ours == peer.pz_set_outputvolts(UNIT, HOST, CHANNEL, counts)


def _their_fields(frame: bytes) -> dict[str, Any]:
    """Return the fields that thorlabs-apt-protocol reads in a message to the host."""
    unpacker = peer.Unpacker(on_error="raise")
    unpacker.feed(frame)
    fields: dict[str, Any] = next(iter(unpacker))._asdict()
    return fields


@given(COUNTS, COUNTS, st.integers(0, 2**32 - 1))
def test_status_reads_the_same(output: int, position: int, bits: int) -> None:
    """A status is read as thorlabs-apt-protocol reads it."""
    status = codec.CubeStatus(output, position, bits)
    frame = codec.long(Id.GET_STATUS, codec.pack_status(1, status), to=HOST, source=UNIT)
    theirs = _their_fields(frame)
    assert codec.status_of(frame) == status
    assert (theirs["output_voltage"], theirs["position"]) == (output, position)
    assert theirs["enabled"] == bool(bits & codec.StatusBit.ENABLED)
    assert theirs["control_mode"] == bool(bits & codec.StatusBit.CLOSED_LOOP)


@given(st.integers(0, 0xFFFF))
def test_display_mode_reads_the_same(mode: int) -> None:
    """The display mode of a strain gauge reader is read as thorlabs-apt-protocol reads it."""
    frame = codec.long(Id.GET_GAUGE_IO, codec.pack_gauge_io(1, mode), to=HOST, source=UNIT)
    assert codec.display_mode_of(frame) == _their_fields(frame)["display_mode"]


def test_identity_reads_the_same() -> None:
    """An identity is read as thorlabs-apt-protocol reads it."""
    hardware = Hardware(29_000_123, "KPZ101", "1.2.3")
    frame = codec.long(Id.GET_INFO, codec.pack_hardware(hardware), to=HOST, source=UNIT)
    theirs = _their_fields(frame)
    assert codec.hardware_of(frame) == hardware
    assert theirs["serial_number"] == hardware.serial
    assert theirs["model_number"].rstrip(b"\0") == b"KPZ101"
    assert theirs["firmware_version"] == [1, 2, 3]


DECODERS: list[Callable[[bytes], object]] = [
    codec.short_of,
    codec.status_of,
    codec.display_mode_of,
    codec.hardware_of,
    lambda frame: codec.words_of(frame, 1),
    lambda frame: codec.words_of(frame, 1, 2),
]


@given(st.binary(max_size=300))
def test_garbage_is_refused_by_the_documented_error(garbage: bytes) -> None:
    """Any bytes are decoded or refused by `AptFrameError`, and raise nothing else."""
    for decode in DECODERS:
        try:
            decode(garbage)
        except AptFrameError:
            continue


@given(st.binary(max_size=300))
def test_frames_are_found_within_what_has_come(garbage: bytes) -> None:
    """A frame is never longer than the bytes that have come, and garbage is dropped by bytes."""
    for length_of in (codec.length_to_host, codec.length_to_unit):
        rest = garbage
        while length := length_of(rest):
            assert -1 <= length <= len(rest)
            rest = rest[abs(length) :]
        assert len(rest) < 6 + codec.MAX_DATA_BYTES


FRAME = codec.long(Id.GET_OUTPUT, codec.words(1, 12345), to=HOST, source=UNIT)


def test_flipped_bits_of_a_header_are_seen() -> None:
    """A voltage with a flipped bit in its header or channel is refused.

    A flipped bit in the voltage itself cannot be detected: the protocol has no checksum.
    """
    unseen = []
    for bit in range(len(FRAME) * 8):
        flipped = bytearray(FRAME)
        flipped[bit // 8] ^= 1 << bit % 8
        frame = bytes(flipped)
        if codec.length_to_host(frame) != len(frame) or codec.ident_of(frame) != Id.GET_OUTPUT:
            continue
        try:
            codec.words_of(frame, 1)
        except AptFrameError:
            continue
        unseen.append(bit)
    data_bits = set(range(64, 80))
    sender_bits = {44, 46}  # the sender 0x50 becomes 0x40 or 0x10, which are no senders
    assert data_bits <= set(unseen)
    assert set(unseen) - data_bits <= {32, *sender_bits}


def test_next_message_is_found_after_garbage() -> None:
    """The next message is found behind garbage."""
    rest = b"\xff\x00\x45\x06" + FRAME
    while (length := codec.length_to_host(rest)) < 0:
        rest = rest[-length:]
    assert rest[:length] == FRAME
