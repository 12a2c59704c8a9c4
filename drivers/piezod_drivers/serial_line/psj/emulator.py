"""Emulated amplifiers of piezosystem jena, as public sources describe them."""

from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Final, Literal

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, EmulatorPlugin
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.psj.emulation.waveform_commands import (
    WaveformCommands,
    WrongValueError,
)
from piezod_drivers.serial_line.psj.emulation.waveforms import Waveforms
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName

MAX_BYTES: Final = 512
LOWEST_V, HIGHEST_V = 0.0, 150.0
"""Limits that the emulated devices report."""

_GREETINGS: Final[Mapping[ProfileName, str]] = MappingProxyType(
    {
        "ddrive": "DSM V6.000",
        "30dv": "AP V1.000",
        "nv40": "NV403CLE>",
        "nv40-1": "NV401CL>",
        "nv200": "NV200/D_NET>",
    }
)
_ENDS_WITH_CR: Final = frozenset({"modon", "monsrc", "sr", "kp", "ki", "kd", "tf", "ktemp"})
"""Some of the commands for which a d-Drive ends a value with CR only."""


class PsjRefusedError(Exception):
    """Raised if a command is refused; its argument is a key of `_ERRORS`."""


_ERRORS: Final[Mapping[str, tuple[str, str, str]]] = MappingProxyType(
    {  # d-Drive, NV40, NV200
        "unknown": ("command not found", "ErrorCode,11", "error,2"),
        "channel": ("channel not present", "ErrorCode,15", "error,2"),
        "missing": ("command mismatch", "ErrorCode,17", "error,3"),
        "many": ("command mismatch", "ErrorCode,11", "error,5"),
        "range": ("command mismatch", "ErrorCode,18", "error,4"),
        "no actuator": ("unit not available", "ErrorCode,25", "error,1"),
    }
)


class PsjEmulator:
    """Implements `Emulator` for every model; an NV40 is under remote control already.

    Args:
        profile_name: Name of the model's profile.
        bench: The rig; axis i is channel i.
        serial: Serial number of the actuators.
    """

    def __init__(self, profile_name: ProfileName, bench: SharedRig, serial: str) -> None:
        self._profile_name, self._profile, self._bench = profile_name, PROFILES[profile_name], bench
        self._serial = serial or "85533"
        self._channels = min(self._profile.channels, bench.n_axes)
        self._rest = b""
        self._setpoint = [0.0] * self._channels
        self._settings: dict[tuple[str, int], float] = {}
        self._readings: list[tuple[int, float]] = [(-NS_PER_S, 0.0)] * self._channels
        self.reads = self._profile.reads
        """Meaning of its reading: an NV40/3 without CLE reads the voltage, and has no loop."""
        self.remote = [True] * self._channels
        """Whether the port sets the voltage of an NV40; else its knob does."""
        self.knob_v = [0.0] * self._channels
        """Voltages of the knobs of an NV40, in V."""
        self.fault_bits = 0
        """Bits of the status word that are inverted, so that tests can cause every fault."""
        self.knows_source = True
        """Whether an NV40/3 knows `stat`, which reports the source of a voltage."""
        self.waveforms: Waveforms | None = None
        """Waveform generator and data recorder of an NV200."""
        self._waveform_commands: Mapping[str, Callable[[list[str]], str | None]] = {}
        if profile_name == "nv200":
            self.waveforms = Waveforms(bench, (LOWEST_V, HIGHEST_V))
            self._waveform_commands = WaveformCommands(self.waveforms).handlers

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete command, in order."""
        self._advance()
        # Commands may end with CR or CR LF.
        *lines, rest = (self._rest + data).replace(b"\n", b"").split(b"\r")
        self._rest = rest[-MAX_BYTES:]
        return [reply for line in lines if (reply := self._answer(line))]

    def due(self) -> list[bytes]:
        """Send nothing."""
        self._advance()
        return []

    def _advance(self) -> None:
        if self.waveforms is not None:
            self.waveforms.advance()

    def _answer(self, line: bytes) -> bytes:
        name, *values = line.decode("latin-1").strip(" \x11\x13").split(",")
        try:
            text = self._execute(name, values)
        except PsjRefusedError as refused:
            text = _ERRORS[refused.args[0]][self._family()]
        if not self._profile.frames:
            return f"{text}\r\n".encode("ascii") if text else b""
        if self._family() == 0 and name in _ENDS_WITH_CR and text.startswith(name):
            return f"{text}\r".encode("ascii")
        return f"\x13{text}\r\n\x11".encode("ascii") if text else b"\x13\x11"

    def _family(self) -> int:
        """Return the column of the model in `_ERRORS` and `_SETTINGS`."""
        return {"ddrive": 0, "30dv": 0, "nv200": 2}.get(self._profile_name, 1)

    def _execute(self, name: str, values: list[str]) -> str:
        if not name:
            return _GREETINGS[self._profile_name]
        if name in {"i1", "i0", "ol", "cl"} and self._profile_name == "nv40-1":
            self._hand_over(0, name)
            return ""
        if (text := self._execute_for_all(name, values)) is not None:
            return text
        if name in self._waveform_commands:
            return self._execute_waveform(name, values)
        commands = self._commands()
        if name not in commands:
            raise PsjRefusedError("unknown")
        channel, given = self._channel(values)
        if len(given) > 1:
            raise PsjRefusedError("many")
        value = _number(given[0]) if given else None
        value_text = commands[name](channel, value)
        if value_text is None:
            return ""
        # An NV40/3 answers `stat` by another word.
        first = "STATUS" if self._profile_name == "nv40" and name == "stat" else name
        return ",".join([first, *([str(channel)] if self._profile.numbered else []), value_text])

    def _execute_waveform(self, name: str, values: list[str]) -> str:
        try:
            text = self._waveform_commands[name](values)
        except WrongValueError as wrong:
            raise PsjRefusedError(*wrong.args) from wrong
        return "" if text is None else f"{name},{text}"

    def _execute_for_all(self, name: str, values: list[str]) -> str | None:
        """Execute a command that names no channel; return None if it is none."""
        n_empty = self._profile.channels - self._channels
        match self._profile_name, name:
            case "nv40", "ERROR":
                # Channels without an axis report "not plugged in".
                words = [f"{self.fault_bits:x}"] * self._channels
                return ",".join(["ERROR", *words, *["1"] * n_empty])
            case "nv40", "ver":
                return f"ver,V1.03\r\nsdate,2026-01-01\r\nserno,{self._serial}"
            case "nv40", "dspvmin" | "dspvmax":
                if values:
                    raise PsjRefusedError("many")
                return f"{name},{LOWEST_V if name == 'dspvmin' else HIGHEST_V:.3f}"
            case "ddrive", "stat" if not values:
                # A line for each slot, empty slots included.
                states = [f"stat,{i},{self._status(i, None)}" for i in range(self._channels)]
                return "\r\n".join([*states, *[_ERRORS["no actuator"][0]] * n_empty])
        return None

    def _commands(self) -> Mapping[str, Callable[[int, float | None], str | None]]:
        profile = self._profile
        commands: dict[str, Callable[[int, float | None], str | None]] = {
            profile.set: self._set,
            profile.read: self._read,
        }
        if profile.status == "stat":
            commands["stat"] = self._status
        if self._profile_name == "nv40" and self.knows_source:
            commands["stat"] = self._source
        if profile.limits is not None and profile.limits_per_channel:
            commands[profile.limits[0]] = lambda _channel, _value: f"{LOWEST_V:.3f}"
            commands[profile.limits[1]] = lambda _channel, _value: f"{HIGHEST_V:.3f}"
        for setting in _SETTINGS[self._family()]:
            if setting != "cloop" or self.reads == "position":  # without CLE the command is unknown
                commands[setting] = self._setting(setting)
        commands["acdescr"] = lambda _channel, _value: f"EMULATED #{self._serial}"
        commands["acserno"] = lambda _channel, _value: self._serial
        return commands

    def _channel(self, values: list[str]) -> tuple[int, list[str]]:
        if not self._profile.numbered:
            return 0, values
        if not values or not values[0]:
            raise PsjRefusedError("missing")
        if values[0] not in [str(channel) for channel in range(self._channels)]:
            raise PsjRefusedError("channel")
        return int(values[0]), values[1:]

    def _set(self, channel: int, value: float | None) -> str | None:
        if value is None:
            if not self._profile.reports_setpoint:
                raise PsjRefusedError("missing")
            return f"{self._setpoint[channel]:.3f}"
        if self._family() == 0:  # a d-Drive limits the value without an error
            value = min(max(value, LOWEST_V), HIGHEST_V)
        if not LOWEST_V <= value <= HIGHEST_V:
            raise PsjRefusedError("range")
        self._setpoint[channel] = value
        if self.waveforms is not None:
            taken = self.waveforms.set_voltage(value)
        else:
            taken = not self.remote[channel] or self._bench.drive(channel, value)
        if not taken:
            raise PsjRefusedError("range")
        return None

    def _hand_over(self, channel: int, word: str) -> None:
        """Execute i1, i0, setk 1 or setk 0: change the source of the voltage."""
        if word in {"i1", "i0"}:
            self.remote[channel] = word == "i1"
            source = self._setpoint if self.remote[channel] else self.knob_v
            self._bench.drive(channel, source[channel])

    def _read(self, channel: int, _value: float | None) -> str:
        t_ns, reading = self._readings[channel]
        now_ns = self._bench.now_ns()
        # Between two refreshes a d-Drive repeats its last reading.
        if now_ns - t_ns >= self._profile.refresh_s * NS_PER_S:
            if self.reads == "voltage":
                reading = self._bench.drive_v(channel)
            else:
                position_um = self._bench.position_um(channel)
                # Without a signal the last reading stays.
                reading = position_um if isfinite(position_um) else reading
            self._readings[channel] = now_ns, reading
        # `setf` switches a d-Drive to scientific notation.
        scientific = self._settings.get(("setf", channel)) == 1.0
        return f"{reading:.6e}" if scientific else f"{reading:.4f}"

    def _source(self, channel: int, _value: float | None) -> str:
        """Return the status word of an NV40/3 channel: bit 7 is set under remote control."""
        closed = bool(self._settings.get(("cloop", channel), 0.0))
        # An actuator with name, serial number and coordinate, with a sensor, is ready.
        return str(0x8017 | self.remote[channel] << 7 | closed << 3)

    def _status(self, channel: int, _value: float | None) -> str:
        closed = bool(self._settings.get(("cl", channel), 0.0))
        if self._profile_name == "nv200":
            # Bit 0: an actuator is plugged in.
            status = 1 | 1 << 1 | closed << 3
        else:
            # Bit 0 as above; bit 6: the high voltage is enabled.
            status = 1 | 1 << 1 | 1 << 6 | closed << 7
        return str(status ^ self.fault_bits)

    def _setting(self, name: str) -> Callable[[int, float | None], str | None]:
        def answer(channel: int, value: float | None) -> str | None:
            if value is None:
                return f"{self._settings.get((name, channel), 0.0):g}"
            self._settings[name, channel] = value
            if name == "setk":
                self._hand_over(channel, "i1" if value else "i0")
            return None

        return answer


_SETTINGS: Final = (
    ("cl", "modon", "monsrc", "sr", "kp", "ki", "kd", "tf", "fan", "setf"),
    ("cloop", "setk", "monwpa"),
    ("cl", "sr", "notchon", "setlpon"),
)
"""Commands that only store and return a value, by family."""


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise PsjRefusedError("missing") from None
    if not isfinite(value):
        raise PsjRefusedError("range")
    return value


def _plugin(
    name: str, profile_name: ProfileName, wire: Literal["serial", "tcp"] = "serial"
) -> EmulatorPlugin:
    def create(bench: SharedRig, serial: str) -> Emulator:
        return PsjEmulator(profile_name, bench, serial)

    how = " over TCP" if wire == "tcp" else ""
    return EmulatorPlugin(
        name, f"piezosystem jena {PROFILES[profile_name].title}{how}", wire, create
    )


D_DRIVE: Final = _plugin("psj-ddrive", "ddrive")
NV40: Final = _plugin("psj-nv40", "nv40")
NV200: Final = _plugin("psj-nv200", "nv200")
NV200_TCP: Final = _plugin("psj-nv200-tcp", "nv200", "tcp")
