"""Asks which voltages are in force on a stage, and reports witnesses that contradict each other.

It collects the evidence of each axis for `control.in_force`, and remembers what follows from the
answer: a read-back that is false does not hold back the writes until it agrees with them again.
"""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite, isnan, nan, sqrt
from types import MappingProxyType
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.register import FaultRegister
from piezod.control.faults.table import mask
from piezod.control.in_force import Claim, Evidence, InForce, Source, left_alone, voltage_in_force
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.boundary import DeviceBoundary
from piezod.control.stage.doubts import AxisDoubt
from piezod.control.watch.axis import AxisWatch
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, s_to_ns

_WRONG_POSITION: Final = (Fault.S1, Fault.S9, Fault.S10, Fault.S13)
"""Faults of a sensor whose samples are valid and nevertheless prove nothing."""
_WRONG: Final = mask(_WRONG_POSITION)
SETTLE_NS: Final = s_to_ns(0.01)
"""The sensor shows where the output has gone after this time, plus the response time of the
stage."""
LEAST_WAY: Final = 0.002
"""Shortest way of the stage that the sensor can judge, as a share of the range."""
LEAST_WAY_SIGMAS: Final = 30.0
"""The same, in standard deviations of the noise of the compared positions."""
AVERAGED: Final = 32
"""Positions are compared as means over up to this many cycles."""
LEAST_WAY_PART: Final = 0.05
"""The same, as a share of the way that the model has predicted since the stage was at rest."""
LEAST_WAY_ERRORS: Final = 8.0
"""The same, in worst errors of the model: that of a way is at most twice that of a position, and a
quarter of the way is the smallest share that decides."""


class _Mean(NamedTuple):
    """Mean of the position, less the one that the model expects, over the last cycles."""

    off_um: float  #: The mean, in µm.
    cycles: int  #: Number of cycles, `AVERAGED` at most.

    def with_one(self, off_um: float) -> "_Mean":
        """Return the mean with the value of one more cycle; without it, if that is NaN."""
        if isnan(off_um):
            return self
        cycles = min(self.cycles + 1, AVERAGED)
        return _Mean(self.off_um + (off_um - self.off_um) / cycles, cycles)


class _Rest(NamedTuple):
    """An axis at rest, when read-back and last write agreed for the last time."""

    read_back_v: float  #: Its read-back, in V.
    expected_um: float  #: Position that the model expected, in µm.
    mean: _Mean  #: The measured position, less that one.
    memory_known: bool  #: Whether the hysteresis memory was known.


_NO_MEAN: Final = _Mean(0.0, 0)
_NONE_LOST: Final[Mapping[int, str]] = MappingProxyType({})
_UNSEEN: Final = _Rest(nan, nan, _NO_MEAN, memory_known=False)


class OutputJudge:
    """Judges which voltages are in force, axis by axis. Real-time safe.

    Args:
        axes: The axes of the stage.
        watches: Their watches.
        register: The faults of the stage.
        boundary: The devices, with the voltages that were written last.
        note: Takes the reports.
        memory_known: Returns whether the hysteresis memory is known.
    """

    def __init__(
        self,
        axes: Sequence[StageAxis],
        watches: Sequence[AxisWatch],
        register: FaultRegister,
        boundary: DeviceBoundary,
        note: Callable[[StageEvent], None],
        memory_known: Callable[[], bool],
    ) -> None:
        self._axes, self._watches, self._register = axes, watches, register
        self._boundary, self._note, self._memory_known = boundary, note, memory_known
        self._expected_um, self._agreed_ns = [nan] * len(axes), [0] * len(axes)
        self._since_ns = [0] * len(axes)
        self._learned_um = [0.0] * len(axes)  # most that the model was away since the last rest
        self.forget()

    # ------------------------------------------------------------------ cycle by cycle

    def see(self, index: int, position_um: float, read_back_v: float, t_ns: int) -> None:
        """Take the position of an axis that is driven and reads back. Call once per cycle.

        Args:
            index: The axis.
            position_um: Its position, in µm; NaN if there is no valid one.
            read_back_v: Its read-back, in V; NaN if there is none.
            t_ns: Instant of the cycle, in ns.
        """
        if not isfinite(read_back_v):
            return
        self._answered = False
        law, watch = self._axes[index].law, self._watches[index]
        sensor = watch.sensor
        expected_um = self._expected_um[index] = law.expected_um
        bound = law.bound
        learned_um = 0.0 if bound is None else bound.distance * sensor.width_um
        self._learned_um[index] = max(self._learned_um[index], learned_um)
        if not watch.amplifier.follows:
            self._means[index] = self._means[index].with_one(position_um - expected_um)
            return
        rests = sensor.rests and (
            abs(read_back_v - law.in_force_v) <= law.limits.read_back_tolerance_v
        )
        if rests:
            wrong = self._register.present & _WRONG and self._is_wrong(index)
            before = self._rests[index].mean if self._rested[index] else _NO_MEAN
            mean = _NO_MEAN if wrong else before.with_one(position_um - expected_um)
            self._rests[index] = _Rest(read_back_v, expected_um, mean, self._memory_known())
            self._learned_um[index] = learned_um
            (self._zeros.add if mean.cycles else self._zeros.discard)(index)
            # Not in motion, which may pass a false read-back by chance.
            self._false.pop(index, None)
        self._rested[index], self._means[index] = rests, _NO_MEAN
        self._agreed_ns[index] = t_ns
        if index in self._doubts and self._doubts[index].agrees(t_ns):
            text = "read-back and last write agree again"
            self._note(StageEvent(t_ns, "info", "output", text, axis=self._axes[index].name))

    def forget(self) -> None:
        """Forget all that was seen of the axes: they were not driven since."""
        self._zeros = set[int]()  # whose position is proven
        self.lose_sight(answered=False)

    def lose_sight(self, *, answered: bool) -> None:
        """Forget where the axes have rested, and what was false: nobody has seen them move since.

        That a zero was proven counts on.

        Args:
            answered: Whether the amplifiers have answered since: then no loss explains a read-back.
        """
        self._answered = answered
        n_axes = len(self._axes)
        self._rests, self._rested = [_UNSEEN] * n_axes, [False] * n_axes
        self._means = [_NO_MEAN] * n_axes  # since read-back and write do not agree any more
        self._last_v = [nan] * n_axes
        self._doubts = dict[int, AxisDoubt]()
        self._false = dict[int, float]()  # axes with a false read-back, and what it showed last

    def live(
        self, read_back_v: Sequence[float], t_ns: int
    ) -> tuple[Sequence[float] | None, Sequence[float] | None]:
        """Return the read-backs to wait for. Call once per cycle.

        Args:
            read_back_v: Read-back of each axis, in V; NaN if there is none in this cycle.
            t_ns: Instant of the cycle, in ns.

        Returns:
            The last read-back of each axis, in V, NaN if there was none or if it is false, and the
            age of each, in s; None in shadow.
        """
        if self._boundary.shadow or not self._boundary.any_reads_back:
            return None, None
        ages_ns = self._boundary.read_back_age_ns(t_ns)
        last_v, since_ns, false = self._last_v, self._since_ns, self._false
        for i, drive_v in enumerate(read_back_v):
            if isfinite(drive_v):
                taken_ns = t_ns - ages_ns[i]
                is_false = i in false and not self._jumps(i, drive_v, taken_ns)
                last_v[i], since_ns[i] = nan if is_false else drive_v, taken_ns
            elif i in false:
                last_v[i] = nan
        return last_v, [(t_ns - each_ns) / NS_PER_S for each_ns in since_ns]

    def _jumps(self, index: int, read_back_v: float, t_ns: int) -> bool:
        """Return whether a false read-back jumps, so that it may be right from now on."""
        before_v, elapsed_s = self._false[index], (t_ns - self._since_ns[index]) / NS_PER_S
        self._false[index] = read_back_v
        jumps = abs(read_back_v - before_v) > self._axes[index].law.limits.reach_v(elapsed_s)
        if jumps:
            del self._false[index]
        return jumps

    # ------------------------------------------------------------------ who starts from a voltage

    def resync(
        self,
        read_back_v: Sequence[float],
        t_ns: int,
        *,
        lost: Mapping[int, str] = _NONE_LOST,
        settles: bool = False,
    ) -> tuple[str, bool]:
        """Take over the outputs of amplifiers that answer again, or that a play has left.

        An amplifier is taken over if the voltages of all its axes are known.

        Args:
            read_back_v: Read-back of each axis, in V; NaN without one, or if the axis is lost.
            t_ns: Instant of the cycle, in ns.
            lost: Why nothing can tell the voltage of an axis, for people.
            settles: Whether the outputs may still settle after a play, a cycle away from its last
                voltage: both count, and the guard keeps the writes near the read-back.

        Returns:
            Why a voltage is unknown, for people, empty if all axes were taken over; and whether
            any axis was.
        """
        found = list[InForce]()
        self._means = [_NO_MEAN] * len(self._axes)  # positions of before the loss prove nothing
        for i, drive_v in enumerate(read_back_v):
            if i in lost or not self._boundary.reads_back[i]:
                kept_v = nan if i in lost else self._axes[i].law.in_force_v
                source = Source.UNKNOWN if i in lost else Source.AGREED
                found.append(InForce(kept_v, source, lost.get(i, "")))
                continue
            if settles and isfinite(self._boundary.written_v[i]):
                found.append(InForce(self._boundary.written_v[i], Source.AGREED))
                continue
            known = self._evidence(i, drive_v, t_ns, explained=self._left_alone(i, drive_v))
            found.append(self._judge(i, known, t_ns))
        amplifiers = self._boundary.amplifiers
        are_known = [isfinite(one.drive_v) for one in found]
        doubted = {one for one, is_known in zip(amplifiers, are_known, strict=True) if not is_known}
        for i, (one, drive_v) in enumerate(zip(found, read_back_v, strict=True)):
            if amplifiers[i] not in doubted and self._boundary.reads_back[i]:
                self._take(i, one, drive_v)
        return self._unknown(found), not doubted.issuperset(amplifiers)

    def settle(self, index: int, read_back_v: float, t_ns: int, *, lost: bool) -> bool:
        """Find out why the output of an axis that ramps down does not follow its writes.

        Args:
            index: The axis, which waits for its output.
            read_back_v: Its read-back, finite, in V.
            t_ns: Instant of the cycle, in ns.
            lost: Whether the last write is out of reach of the output.

        Returns:
            Whether the ramp has to start again at the read-back.
        """
        found = self._judge(index, self._evidence(index, read_back_v, t_ns), t_ns)
        if found.source is Source.WRITTEN:
            self._false[index] = read_back_v
        if found.source is not Source.READ_BACK or not lost:
            return False
        self._take(index, found, read_back_v)
        return True

    def doubt(self, ahead_s: float = 0.0) -> str:
        """Return why the stage may not be driven from where it is; empty if nothing is against it.

        Args:
            ahead_s: Time by which the last write may be ahead: of a process that was killed, the
                last one may not have arrived. If read-back and last write agree so far, that
                decides.
        """
        for i, axis in enumerate(self._axes):
            tracked_v, limits = axis.law.in_force_v, axis.law.limits
            off_v = abs(self._boundary.written_v[i] - tracked_v)
            if ahead_s and off_v <= limits.reach_v(ahead_s):
                continue
            reads_back = self._boundary.reads_back[i]
            known = self._evidence(i, tracked_v if reads_back else nan, 0)
            if not reads_back:
                known = known._replace(written=self._claim(i, tracked_v))
            found = voltage_in_force(known, limits.read_back_tolerance_v)
            if not found.proven:
                return (
                    f"axis {axis.name}: {found.doubt}: check read-back, output and sensor; bring "
                    f"the output to the rest voltage and `piezod zero`, or, if the output is at "
                    f"its read-back, `piezod arm --confirm-output`"
                )
        return ""

    def told(self, index: int) -> str:
        """Return the doubt about the voltage of an axis, for people; empty if there is none."""
        return self._doubts[index].text if index in self._doubts else ""

    # ------------------------------------------------------------------ the evidence

    def _evidence(
        self, index: int, read_back_v: float, t_ns: int, *, explained: bool = False
    ) -> Evidence:
        """Return what is known of an axis; `moved` only if the instant is given."""
        tolerance_v = self._axes[index].law.limits.read_back_tolerance_v
        written_v, sample = self._boundary.written_v[index], self._watches[index].sensor.sample
        sent_v = self._boundary.sent_v[index] if self._boundary.sent_v is not None else nan
        low_v, high_v = min(written_v, sent_v), max(written_v, sent_v)
        if abs(read_back_v - sent_v) <= tolerance_v or low_v <= read_back_v <= high_v:
            written_v = read_back_v  # one of the writes that were not acknowledged is in force
        position_um = sample.position_um if sample.valid else nan
        moved = self._moved(index, read_back_v, position_um, t_ns) if t_ns else nan
        # A zero is proven where read-back and write have agreed at rest, and S9 found nothing. To
        # arm, any contradiction counts.
        if self._is_wrong(index) or (t_ns and index not in self._zeros):
            position_um = nan
        return Evidence(
            self._claim(index, read_back_v),
            self._claim(index, written_v),
            position_um,
            moved,
            self._watches[index].amplifier.reports_move,
            explained,
        )

    def _moved(self, index: int, read_back_v: float, position_um: float, t_ns: int) -> float:
        """Return the share of the way to the read-back that the sensor has seen; NaN if unknown.

        It is unknown if the hysteresis memory was: then the model expects a wrong way.

        The model expects the position at the last write. At the read-back the stage would be where
        it rested, and on by the mean slope as far as the read-back has moved since.
        """
        sensor, rest = self._watches[index].sensor, self._rests[index]
        expected_um = self._expected_um[index]
        predicted_um = expected_um - rest.expected_um
        way_um = sensor.gain_um_per_v * (read_back_v - rest.read_back_v) - predicted_um
        # After a loss nothing was averaged: then the present position counts.
        mean = self._means[index]
        mean = mean if mean.cycles else _NO_MEAN.with_one(position_um - expected_um)
        averaged = min(mean.cycles, rest.mean.cycles)
        least_um = max(
            LEAST_WAY * sensor.width_um,
            LEAST_WAY_SIGMAS * sensor.noise_um / sqrt(max(averaged, 1)),
            LEAST_WAY_PART * abs(predicted_um),
            # What was learned, perhaps from a sensor that lies, may be as wrong as it is far, and
            # drops out of the model when a fault is found.
            LEAST_WAY_ERRORS * (sensor.model_error_um + self._learned_um[index]),
        )
        settled = t_ns - self._agreed_ns[index] > SETTLE_NS + sensor.answer_ns
        if not (rest.memory_known and settled):
            return nan
        if not (averaged and abs(way_um) > least_um):  # also without a model
            return nan
        return (mean.off_um - rest.mean.off_um) / way_um

    def _left_alone(self, index: int, read_back_v: float) -> bool:
        """Return whether an output that was out of reach has come to its read-back by itself."""
        axis, written_v = self._axes[index], self._boundary.written_v[index]
        tolerance_v, rest_v = axis.law.limits.read_back_tolerance_v, axis.config.limits.rest_v
        watchdog = self._boundary.watchdog[index]
        answered = self._answered or self._watches[index].amplifier.unexplained_fall
        return not answered and left_alone(
            read_back_v, written_v, rest_v, tolerance_v, watchdog=watchdog
        )

    def _claim(self, index: int, drive_v: float) -> Claim:
        return Claim(drive_v, *self._watches[index].sensor.allowed_um(drive_v))

    def _is_wrong(self, index: int) -> bool:
        """Return whether the samples of an axis are known to prove nothing."""
        return any(self._register.axes_of(fault) >> index & 1 for fault in _WRONG_POSITION)

    def _judge(self, index: int, known: Evidence, t_ns: int) -> InForce:
        """Return the voltage in force; report a doubt."""
        axis = self._axes[index]
        found = voltage_in_force(known, axis.law.limits.read_back_tolerance_v)
        if not found.doubt and index not in self._doubts:
            return found
        if text := self._doubts.setdefault(index, AxisDoubt()).found(found):
            self._note(StageEvent(t_ns, "warning", "output", text, axis=axis.name))
        return found

    def _take(self, index: int, found: InForce, read_back_v: float) -> None:
        """Go on from the voltage in force."""
        if found.source is Source.WRITTEN:
            self._false[index] = read_back_v
        else:
            self._boundary.forget_sent(index)
        self._watches[index].amplifier.taken_over(found.drive_v)
        self._boundary.took_over(index, found.drive_v)
        self._axes[index].track(found.drive_v)

    def _unknown(self, found: Sequence[InForce]) -> str:
        """Return the doubts about axes whose voltage is unknown, for people."""
        return "; ".join(
            f"axis {axis.name}: {one.doubt}"
            for axis, one in zip(self._axes, found, strict=True)
            if not isfinite(one.drive_v)
        )
