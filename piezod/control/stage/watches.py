"""All that looks for faults of a stage, once in each cycle: of its loop, devices and axes."""

from collections.abc import Sequence
from math import isfinite, nan
from typing import Final

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.register import Detection
from piezod.control.stage.record import StageEvent
from piezod.control.stage.stage import DRIVEN, SENSED, Stage
from piezod.control.watch.loop import CycleTiming, LoopWatch
from piezod.devices.interface import Sample
from piezod.devices.status import Flags

SILENT_CYCLES: Final = 5
"""An amplifier that reads back, and does not for so many cycles, is lost."""

_UNVERIFIED, _FORGOTTEN = Detection(Fault.A10), Detection(Fault.D10)
_COMPENSATING: Final = frozenset({State.READY, State.RUN, State.HOLD})


def crashed(stage: Stage, t_ns: int, fault: Fault, axis: int, text: str) -> Detection:
    """Note what was raised; return the fault that it is; may be called in the loop."""
    stage.note(StageEvent(t_ns, "error", "crash", text, fault))
    return Detection(fault, axis)


class StageWatches:
    """Asks all watches of a stage.

    Args:
        stage: The stage.
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self._loop_watch = LoopWatch(stage.period_ns)
        self._t_ns = 0
        self._read_back_v: Sequence[float] = ()

    def check(
        self,
        t_ns: int,
        samples: Sequence[Sample],
        read_back_v: Sequence[float],
        timing: CycleTiming,
    ) -> Sequence[Detection]:
        """Return what is wrong; call it once in each cycle, after the read; in the loop.

        Args:
            t_ns: Instant of the cycle.
            samples: What was measured.
            read_back_v: What the amplifiers tell, NaN where they do not, or in shadow.
            timing: How punctual the loop is.
        """
        self._t_ns, self._read_back_v = t_ns, read_back_v
        self._check_read_back(self.stage.boundary.shadow)
        return self._detect(t_ns, samples, timing)

    def _check_read_back(self, shadow: bool) -> None:
        """Follow whether it is known what is in force; an amplifier that falls silent is lost."""
        stage = self.stage
        if shadow or not stage.boundary.reads_back:
            return
        known = all(map(isfinite, self._read_back_v))
        if stage.state not in DRIVEN:
            stage.output_known, stage.silent_cycles = known, 0
            return
        stage.silent_cycles = 0 if known else stage.silent_cycles + 1
        if stage.silent_cycles >= SILENT_CYCLES:
            stage.found.append(Detection(Fault.A1, -1, stage.silent_cycles, SILENT_CYCLES))

    def _detect(
        self, t_ns: int, samples: Sequence[Sample], timing: CycleTiming
    ) -> Sequence[Detection]:
        stage = self.stage
        found = [*self._loop_watch.check(timing), *stage.found]
        stage.found.clear()
        if stage.boundary.active:
            flags = stage.boundary.status(t_ns)
            of_amplifiers = len(samples)
            for i, sample in enumerate(samples):
                found += self._detect_on(i, t_ns, sample, flags[i], flags[of_amplifiers + i])
        if stage.boundary.crash is not None:
            text = f"a driver failed: {stage.boundary.crash!r}"
            found.append(crashed(stage, t_ns, Fault.P3, -1, text))
            stage.boundary.crash = None
        if stage.estop_pressed:
            found.append(Detection(Fault.E1))
        if stage.state in DRIVEN and not (stage.boundary.reads_back or stage.boundary.shadow):
            found.append(_UNVERIFIED)
        if not stage.memory_known and stage.state in _COMPENSATING and _compensates(stage):
            found.append(_FORGOTTEN)
        return found

    def _detect_on(
        self, i: int, t_ns: int, sample: Sample, of_sensor: Flags, of_amplifier: Flags
    ) -> Sequence[Detection]:
        """Return what is wrong on one axis."""
        stage = self.stage
        axis, watches = stage.axes[i], stage.watches[i]
        closed = stage.state is State.RUN and axis.mode in SENSED
        found = [*watches.bus.check(of_sensor, of_amplifier)]
        for detection in watches.sensor.check(
            t_ns,
            sample,
            of_sensor,
            axis.live.in_force_v,
            axis.command_um,
            driven=stage.state in DRIVEN and not stage.boundary.shadow,
            needed=closed,
        ):
            if detection.fault is not Fault.S5 or not watches.bus.explains_silence:
                found.append(detection)
        found += watches.amplifier.check(self._read_back_v[i], of_amplifier)
        usable = watches.sensor.sample
        position_um = usable.position_um if usable.valid else nan
        noise_um = watches.sensor.noise_um
        found += watches.adaptation.check(
            axis.command_um, position_um, closed=closed, noise_um=noise_um
        )
        if axis.crash is not None:
            found.append(
                crashed(stage, t_ns, Fault.P4, i, f"axis {stage.names[i]}: {axis.crash!r}")
            )
            axis.crash = None
        return found


def _compensates(stage: Stage) -> bool:
    """Tell whether an axis relies on what is remembered of its hysteresis."""
    return any(axis.mode is not Mode.UNCOMPENSATED for axis in stage.axes)
