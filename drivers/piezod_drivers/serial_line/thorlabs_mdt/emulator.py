"""The emulated MDT693B and MDT694B amplifiers, and all plug-ins."""

from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, EmulatorPlugin
from piezod_drivers.serial_line.thorlabs_mdt.emulation.a_model import MdtAEmulator
from piezod_drivers.serial_line.thorlabs_mdt.emulation.values import LIMIT_V, RefusalError, volts

_LONGEST: Final = 128
_HIGHEST_V: Final = 150.5
_UNKNOWN, _INVALID = "CMD_NOT_DEFINED", "CMD_ARG_INVALID"
_PAIR: Final = {ord("\r"): ord("\n"), ord("\n"): ord("\r")}
"""Either byte ends a command, and so do both together, in any order."""


class MdtModel(NamedTuple):
    """Properties in which the amplifiers differ."""

    name: str  #: Reported model.
    axes: str  #: Names of its axes.
    firmware: str  #: Reported firmware.


class MdtEmulator(Emulator):
    """Implements `Emulator`: voltages, their limits, identity, echo and compatibility mode.

    Args:
        serial: Serial number, "" for its usual one.
    """

    def __init__(self, model: MdtModel, bench: SharedRig, serial: str) -> None:
        self._model, self._bench = model, bench
        self._serial = serial or "140421-07"
        self._axes = model.axes[: bench.n_axes]
        # After power-up the echo is on.
        self.echo, self.compatible = True, False
        self._line = b""
        self._partner = -1  # byte that would belong to the last end of a command
        self._long: dict[str, Callable[[str], str]] = {
            "ID?": self._identify,
            "SERIAL?": lambda _: f"{self._serial}\r",
            "FRIENDLY?": lambda _: "piezo\r",
            "ECHO=": self._set_echo,
            "VLIMIT?": lambda _: f"[ {LIMIT_V:.0f}]\r",
            "CM?": lambda _: f"[MDT693A Compatibility Mode {'On' if self.compatible else 'Off'}]\r",
            "CM=": self._set_compatible,
        }
        self._short: dict[str, Callable[[str], str]] = {
            "I": self._identify,
            "E": self._set_echo,
            "%": self._long["VLIMIT?"],
        }
        if len(self._axes) == 3:
            self._long |= {"XYZVOLTAGE?": self._get_all, "XYZVOLTAGE=": self._set_all}
        for i, name in enumerate(self._axes):
            self._add_axis(i, name)

    def receive(self, data: bytes) -> list[bytes]:
        """Process bytes of the host; return the replies."""
        replies = []
        for byte in data:
            is_partner, self._partner = byte == self._partner, -1
            if is_partner:
                continue
            if byte in _PAIR:
                line, self._line = self._line, b""
                replies.append(self._answer(line, chr(byte)))
                self._partner = _PAIR[byte]
            elif len(self._line) < _LONGEST:
                self._line += bytes((byte,))
        return replies

    def _answer(self, line: bytes, end: str) -> bytes:
        text = line.decode("ascii", "replace")
        echo = f"{text}{end}" if self.echo else ""
        try:
            body, refused = self._execute(text.strip().upper()), False
        except RefusalError as refusal:
            body, refused = str(refusal), True
        if not self.compatible:
            return f"{echo}{body}>".encode("ascii", "replace")
        if refused:
            return f"{echo}!".encode("ascii", "replace")
        return f"{echo}{body}*".encode("ascii", "replace")

    def _execute(self, text: str) -> str:
        for commands in (self._long, self._short):
            # The longest command first, because one may begin another: "XR" and "XR?".
            for word in sorted(commands, key=len, reverse=True):
                if text == word or (text.startswith(word) and word[-1] not in "?IR%"):
                    return commands[word](text.removeprefix(word).strip())
        raise RefusalError(_UNKNOWN)

    def _add_axis(self, i: int, name: str) -> None:
        get, put = partial(self._get, i), partial(self._set, i)
        self._long |= {f"{name}VOLTAGE?": get, f"{name}VOLTAGE=": put}
        self._long |= {f"{name}MIN?": lambda _: "0\r"}
        self._long |= {f"{name}MAX?": lambda _: f"{_HIGHEST_V:.2f}\r"}
        self._short |= {f"{name}R?": get, f"{name}R": get, f"{name}V": put}
        self._short |= {f"{name}L?": self._long[f"{name}MIN?"]}
        self._short |= {f"{name}H?": self._long[f"{name}MAX?"]}

    def _identify(self, _text: str) -> str:
        lines = (
            f"\r\r\rModel {self._model.name} Piezo Control Module",
            f"Firmware Version: {self._model.firmware}",
            "Voltage Range: 0V to 150V",
            f"Serial#:{self._serial}",
            "Friendly Name:piezo",
            "Thorlabs, Inc. Newton, NJ 07860",
            "www.thorlabs.com",
        )
        return "\r".join((*lines, "", ""))

    def _set_echo(self, text: str) -> str:
        self.echo = _switch(text)
        return f"[Echo {'On' if self.echo else 'Off'}]\r"

    def _set_compatible(self, text: str) -> str:
        self.compatible = _switch(text)
        return self._long["CM?"]("")

    def _get(self, axis: int, _text: str) -> str:
        return f"[{self._bench.drive_v(axis):6.2f}]\r"

    def _set(self, axis: int, text: str) -> str:
        value_v = volts(text, _INVALID)
        if not self._bench.drive(axis, value_v):
            raise RefusalError(_INVALID)
        return ""

    def _get_all(self, _text: str) -> str:
        values = (f"{self._bench.drive_v(i):6.2f}" for i in range(len(self._axes)))
        return f"[{','.join(values)}]\r"

    def _set_all(self, text: str) -> str:
        values_v = [volts(part.strip(), _INVALID) for part in text.split(",")]
        if len(values_v) != len(self._axes) or not self._bench.drive_all(values_v):
            raise RefusalError(_INVALID)
        return ""


def _switch(text: str) -> bool:
    if text not in {"0", "1"}:
        raise RefusalError(_INVALID)
    return text == "1"


def _plugin(
    profile: str, name: str, axes: str, create: Callable[[SharedRig, str], Emulator]
) -> EmulatorPlugin:
    return EmulatorPlugin(
        name=profile,
        summary=f"Thorlabs {name}, amplifier with {len(axes)} outputs",
        wire="serial",
        create=create,
    )


def _b_plugin(profile: str, model: MdtModel) -> EmulatorPlugin:
    return _plugin(profile, model.name, model.axes, partial(MdtEmulator, model))


MDT693A: Final = _plugin("mdt693a", "MDT693A", "XYZ", MdtAEmulator)
MDT693B: Final = _b_plugin("mdt693b", MdtModel("MDT693B", "XYZ", "2.09"))
MDT694B: Final = _b_plugin("mdt694b", MdtModel("MDT694B", "X", "2.09"))
