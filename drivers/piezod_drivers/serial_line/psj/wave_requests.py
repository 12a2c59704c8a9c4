"""The exchanges with the waveform generator and the data recorder of an NV200/D."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.player import Check
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.session import PsjSession

CLOCK_NS: Final = 50_000
N_POINTS: Final = 1024
N_SAMPLES: Final = 6144
MOST_FACTOR: Final = 65_535
MOST_CYCLES: Final = 65_535
NEAR_PCT: Final = 2e-3
"""Largest difference between a point and its read-back: one digit, and a little."""
_BY_COMMAND, _BY_GENERATOR = "0", "3"
"""Sources of the setpoint (`modsrc`)."""
_POSITION, _VOLTAGE = 0, 2
"""Sources of the recorder: channel 0 records the position, channel 1 the voltage."""
_ON_RUN: Final = 2
"""The recorder starts with the generator (`recast`)."""
_SHORT: Final = 20
"""Samples of a record of which only the first one is read, as the maker's library does."""
_NEAR_V: Final = 0.01
_STEADY_V: Final = 1.0
"""Largest difference between two samples of the voltage of a generator that has stopped."""
_SLACK_NS: Final = 250_000_000
_BYTES_PER_SAMPLE: Final = 10
_BITS: Final = 10


class WaveRequests:
    """Asks and sets generator and recorder.

    All methods raise `LineFault` if the device refuses, or does not reply.

    Args:
        baud: Bits per second on the line.
    """

    def __init__(self, session: PsjSession, baud: int) -> None:
        self._session, self._baud = session, baud

    def voltages(self) -> tuple[float, float]:
        """Return the voltages at 0 and 100 % of a waveform, in V."""
        low, high = (codec.number(self._session.value(name)) for name in ("avmin", "avmax"))
        return low, high

    def position_um(self) -> float:
        """Return the position, in µm."""
        return codec.number(self._session.value("meas"))

    def setpoint_v(self) -> float:
        """Return the setpoint of the command, in V. Real-time safe."""
        return codec.number(self._session.value("set"))

    def is_closed(self) -> bool:
        """Return whether the device's own loop is closed: then a waveform is of positions."""
        return self._session.value("cl") != "0"

    def is_source(self) -> bool:
        """Return whether the generator is the source of the setpoint. Real-time safe."""
        return self._session.value("modsrc") == _BY_GENERATOR

    def is_running(self) -> bool:
        """Return whether the generator runs. Real-time safe."""
        return self._session.value("grun") != "0"

    def index(self) -> int:
        """Return the index of the present point. Real-time safe."""
        return int(codec.number(self._session.value("giarb")))

    def write_points(self, percents: Sequence[float], check: Check) -> list[float]:
        """Write a waveform; return it as the device holds it, in %.

        Raises:
            DeviceError: If it holds other values.
        """
        held = []
        for i, percent in enumerate(percents):
            check()
            self._session.ask("gbarb", None, i, float(percent))
            values = self._session.indexed("gbarb", i)
            value = codec.number(values[0] if len(values) == 1 else "")
            if not abs(value - percent) <= NEAR_PCT:
                raise DeviceError(
                    f"the waveform holds {value:g} % at point {i} instead of {percent:.3f} %"
                )
            held.append(value)
        return held

    def prepare(self, n_lead_in: int, n_points: int, cycles: int, factor: int) -> None:
        """Stop the generator; set which points it plays, how often, and how fast."""
        settings = {
            "grun": 0,
            "goarb": 0,
            "gsarb": n_lead_in,
            "gearb": n_points - 1,
            "gcarb": cycles,
            "gtarb": factor,
        }
        for name, value in settings.items():
            self._session.ask(name, None, value)

    def prepare_record(self, n_samples: int, factor: int) -> None:
        """Let the recorder wait for the generator; it records position and voltage."""
        self._record(n_samples, factor, _ON_RUN)

    def start(self) -> bool:
        """Start the generator, and make it the source; return whether it runs.

        It is started first: then its first points are known to come out. If it does not run before
        it is the source, nothing moves.
        """
        self._session.ask("grun", None, 1)
        if not self.is_running():
            return False
        self._session.ask("modsrc", None, int(_BY_GENERATOR))
        return True

    def stop(self) -> float:
        """Stop the generator, and make the command the source; return the voltage in force, in V.

        The setpoint of the command becomes the voltage at which the generator has stopped, as the
        recorder measures it. Real-time safe.
        """
        self._session.ask("grun", None, 0)
        if self.is_source():
            self._record(_SHORT, 1, 0)
            first_v, second_v = self._sample_v(0), self._sample_v(1)
            # A digit that has become another one can only be detected by a second sample.
            if not abs(second_v - first_v) <= _STEADY_V:
                what = f"the measured voltage is {first_v:g} V, then {second_v:g} V"
                raise LineFault(DeviceFlag.GARBAGE, what)
            self.take_over(second_v)
        return self.setpoint_v()

    def take_over(self, drive_v: float) -> None:
        """Make the command the source of the setpoint, at a voltage, in V. Real-time safe."""
        low_v, high_v = self.voltages()
        drive_v = min(max(drive_v, low_v), high_v)  # a measured voltage may be a little beyond
        self._session.ask("set", None, drive_v)
        held_v = self.setpoint_v()
        if not abs(held_v - drive_v) <= _NEAR_V:
            what = f"the setpoint is {held_v:g} V instead of {drive_v:.3f} V"
            raise LineFault(DeviceFlag.WRONG_REQUEST, f"{what}; the waveform stays its source")
        self._session.ask("modsrc", None, int(_BY_COMMAND))

    def recorded(self, channel: int, n_samples: int) -> list[float]:
        """Return the first samples of a channel of the recorder.

        Raises:
            DeviceError: If there are fewer.
        """
        # Twice the time of the reply: a lost one blocks the line for ten time-outs.
        within_ns = _SLACK_NS + 2 * n_samples * _BYTES_PER_SAMPLE * _BITS * NS_PER_S // self._baud
        values = self._session.record("recoutf", channel, within_ns)
        if len(values) < n_samples:
            raise DeviceError(f"the record has {len(values)} points, expected {n_samples}")
        return [codec.number(value) for value in values[:n_samples]]

    def _sample_v(self, index: int) -> float:
        """Return a sample of the recorded voltage, in V. Real-time safe."""
        values = self._session.indexed("recout", 1, index, 1)
        # The reply has the index, and its value.
        return codec.number(values[1] if len(values) == 2 and values[0] == str(index) else "")

    def _record(self, n_samples: int, factor: int, starts: int) -> None:
        ask = self._session.ask
        ask("recrun", None, 0)
        ask("recast", None, starts)
        ask("recsrc", None, 0, _POSITION)
        ask("recsrc", None, 1, _VOLTAGE)
        ask("recstr", None, factor)
        ask("reclen", None, n_samples)
        ask("recrun", None, 1)
