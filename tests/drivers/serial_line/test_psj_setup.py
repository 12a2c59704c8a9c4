"""Opening piezosystem jena's amplifiers and taking control of them."""

import pytest

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName, ReadingUse
from tests.drivers.serial_line.psj_rig import ALL, Rig


@pytest.mark.parametrize(
    ("profile", "reads", "expected"),
    [
        ("ddrive", None, False),
        ("nv40", None, False),
        ("nv40", "voltage", True),
        ("nv40-1", None, True),
        ("nv200", None, True),
    ],
)
def test_only_readings_of_the_device_count_as_read_back(
    profile: ProfileName, reads: ReadingUse | None, expected: bool
) -> None:
    """A setpoint that cannot be read is not called read back."""
    rig = Rig(profile, reads)
    rig.device.open()

    assert expected == rig.device.capabilities().read_back


def test_a_d_drive_has_no_input_unless_it_is_asked_for() -> None:
    """A d-Drive's reading is no input unless it is configured."""
    rig = Rig("ddrive")
    rig.started()

    assert rig.device.capabilities().inputs == ()


@pytest.mark.parametrize(
    ("profile", "before"),
    [
        ("ddrive", b"cl,0,1\r\n"),
        ("ddrive", b"modon,0,1\r\n"),
        ("nv40", b"cloop,0,1\r"),
        ("nv200", b"cl,1\r"),
        ("nv200", b"modsrc,1\r"),
    ],
)
def test_control_is_not_taken_where_the_voltage_would_jump(
    profile: ProfileName, before: bytes
) -> None:
    """In closed loop, or with another source, control is refused with the remedy."""
    rig = Rig(profile)
    rig.send(before)
    rig.device.open()

    with pytest.raises(DeviceError, match="may jump"):
        rig.device.activate(rig.now_ns())


@pytest.mark.parametrize("reads", ["position", "voltage", "nothing"])
def test_an_nv40_is_asked_for_its_loop_whatever_its_reading_is_used_for(reads: ReadingUse) -> None:
    """The loop of an NV40 is read for any use of its reading."""
    rig = Rig("nv40", reads)
    rig.emulator.reads = "position"  # a CLE, whatever is configured
    rig.send(b"cloop,0,1\r")
    rig.device.open()

    with pytest.raises(DeviceError, match="channel 0 is in closed loop"):
        rig.device.activate(rig.now_ns())


def test_an_nv40_without_a_loop_refuses_to_be_asked_for_it() -> None:
    """An NV40 without CLE does not know the query, and has no loop to be closed."""
    rig = Rig("nv40", "voltage")
    assert rig.emulator.receive(b"cloop,0\r") == [b"\x13ErrorCode,11\r\n\x11"]

    assert rig.started().write([5.0], rig.now_ns())


@pytest.mark.parametrize(
    ("answer", "why"), [(b"", "no reply"), (b"\x13ErrorCode,17\r\n\x11", "ErrorCode,17")]
)
def test_an_nv40_that_does_not_tell_of_its_loop_is_not_driven(answer: bytes, why: str) -> None:
    """No reply, or another refusal, does not count as an open loop."""
    rig = Rig("nv40", "voltage")
    rig.device.open()
    rig.line.change = lambda reply: answer if b"cloop" in rig.line.sent[-1] else reply

    with pytest.raises(DeviceUnavailableError, match=why):
        rig.device.activate(rig.now_ns())


@pytest.mark.parametrize("profile", ALL)
def test_taking_and_leaving_control_moves_nothing(profile: ProfileName) -> None:
    """Opening, activating and closing a device keep its voltage."""
    rig = Rig(profile, "voltage" if profile == "nv40" else None)
    rig.send(f"{PROFILES[profile].set},{'0,' if PROFILES[profile].numbered else ''}33\r".encode())

    rig.started()
    rig.device.close()

    assert rig.rig.drive_v[:1] == [33.0]


NV40S: list[tuple[ProfileName, ReadingUse | None, bytes, bytes]] = [
    ("nv40", None, b"set,0,10\r", b"setk,0,%d\r"),
    ("nv40", "voltage", b"set,0,10\r", b"setk,0,%d\r"),
    ("nv40-1", None, b"wr,10\r", b"i%d\r"),
]


@pytest.mark.parametrize(("profile", "reads", "put", "hand_over"), NV40S)
def test_an_emulated_nv40_jumps_when_it_comes_under_remote_control(
    profile: ProfileName, reads: ReadingUse | None, put: bytes, hand_over: bytes
) -> None:
    """An emulated NV40 jumps from its knob's voltage to an unknown setpoint."""
    rig = Rig(profile, reads)
    rig.emulator.knob_v[0] = 40.0
    seen = []
    for request in (hand_over % 0, put, hand_over % 1):
        rig.send(request)
        seen.append(rig.rig.drive_v[0])

    assert seen == [40.0, 40.0, 10.0]


@pytest.mark.parametrize("remote", [False, True])
@pytest.mark.parametrize(("profile", "reads", "put", "hand_over"), NV40S)
def test_an_nv40_is_never_put_under_remote_control(
    profile: ProfileName, reads: ReadingUse | None, put: bytes, hand_over: bytes, *, remote: bool
) -> None:
    """Without a report and without `remote: true` an NV40 is refused, and its voltage stays."""
    rig = Rig(profile, reads, remote=remote)
    rig.emulator.knows_source = False
    rig.emulator.knob_v[0] = 40.0
    rig.send(hand_over % 0)
    rig.send(put)
    rig.device.open()

    if remote:
        rig.device.activate(rig.now_ns())
    else:
        with pytest.raises(DeviceError, match=r"may jump.*send (setk|i1).*`remote: true`"):
            rig.device.activate(rig.now_ns())
    rig.device.close()
    assert rig.rig.drive_v[0] == 40.0


@pytest.mark.parametrize("confirmed", [False, True])
def test_an_nv40_that_reports_its_source_is_believed(*, confirmed: bool) -> None:
    """The reported source of the voltage counts, whatever the configuration confirms."""
    rig = Rig("nv40", wiring=Wiring((), ("ch0", "ch1")), remote=confirmed)
    rig.send(b"setk,1,0\r")
    rig.device.open()
    with pytest.raises(DeviceError, match=r"channel 1 is not under remote control.*setk,1,1"):
        rig.device.activate(rig.now_ns())

    rig.send(b"setk,1,1\r")
    rig.device.activate(rig.now_ns())

    assert rig.device.write([5.0, 6.0], rig.now_ns())


@pytest.mark.parametrize("profile", ALL)
def test_half_a_setpoint_is_not_obeyed_when_the_device_is_opened_again(
    profile: ProfileName,
) -> None:
    """Half a sent setpoint never takes effect."""
    rig = Rig(profile)
    numbered = PROFILES[profile].numbered
    rig.send(f"{PROFILES[profile].set},{'0,' if numbered else ''}1".encode())

    rig.device.open()

    assert rig.rig.drive_v[0] == 0.0


@pytest.mark.parametrize("profile", ALL)
def test_another_model_is_refused(profile: ProfileName) -> None:
    """A device that greets as another model is refused, and the error names both."""
    rig = Rig(profile)
    rig.line.change = lambda _reply: b"\x13OTHER>\r\n\x11"

    with pytest.raises(DeviceError, match=r"OTHER.*set `profile`"):
        rig.device.open()


@pytest.mark.parametrize("profile", ALL)
def test_silence_means_an_absent_device(profile: ProfileName) -> None:
    """A port without reply is an unavailable device."""
    rig = Rig(profile)
    rig.line.change = lambda _reply: b""

    with pytest.raises(DeviceUnavailableError):
        rig.device.open()


def test_leftover_bytes_do_not_spoil_the_greeting() -> None:
    """Pending bytes are answered by the first of two requests."""
    rig = Rig("nv40")
    rig.send(b"se")
    rig.line.open()
    rig.line.comes(b"k,0\r\n\x11")

    assert rig.device.open()[1:3] == ("NV403CLE", "4711")


@pytest.mark.parametrize(
    ("profile", "serial"),
    [("ddrive", "actuator EMULATED #4711"), ("nv40", "4711"), ("nv200", "actuator 4711")],
)
def test_devices_of_a_kind_are_distinguished(profile: ProfileName, serial: str) -> None:
    """The serial number, or the actuator, distinguishes devices of a model."""
    assert serial == Rig(profile).device.open().serial


@pytest.mark.parametrize("profile", ["ddrive", "nv40"])
def test_a_missing_serial_number_is_unknown(profile: ProfileName) -> None:
    """Firmware without a serial number command is accepted."""
    rig = Rig(profile)
    rig.line.change = lambda reply: b"" if b"4711" in reply else reply

    assert rig.device.open().serial == "unknown"
    rig.device.close()
    assert rig.started().write([5.0], rig.now_ns())


def test_a_line_lost_during_the_serial_number_query_is_reported() -> None:
    """A line that is lost while the serial number is read makes the device unavailable."""
    rig = Rig("ddrive")

    def pull(reply: bytes) -> bytes:
        rig.line.unplugged |= b"4711" in reply
        return reply

    rig.line.change = pull
    with pytest.raises(DeviceUnavailableError, match="is gone"):
        rig.device.open()


def test_the_devices_own_limits_narrow_the_range() -> None:
    """Values beyond the device's own limits are refused without asking it."""
    rig = Rig("nv200")  # it reports 0 to 150 V, configured are -20 to 130 V
    device = rig.started()

    answers = [device.write([drive_v], rig.now_ns()) for drive_v in (-1.0, 0.0, 130.0, 131.0)]

    assert answers == [False, True, True, False]
    assert len(rig.line.sent) == 2


def test_limits_that_leave_nothing_are_an_error() -> None:
    """A range without a possible voltage is refused at opening."""
    rig = Rig("nv200")
    rig.line.change = lambda reply: reply.replace(b"150.000", b"-30.000")

    with pytest.raises(DeviceError, match="range_v"):
        rig.device.open()


@pytest.mark.parametrize(("profile", "low_hz", "high_hz"), [("nv40", 24, 40), ("nv200", 100, 150)])
def test_the_fastest_loop_is_what_the_wire_allows(
    profile: ProfileName, low_hz: float, high_hz: float
) -> None:
    """The highest rate is limited by the bytes of a cycle."""
    rig = Rig(profile)
    rig.device.open()

    assert low_hz < rig.device.capabilities().max_rate_hz < high_hz
