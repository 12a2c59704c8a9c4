"""A reply that is late by up to ten time-outs is never taken for another one."""

import random
from collections import Counter
from typing import Any

import pytest

from tests.conftest import Figure
from tests.drivers.bus.profiles import PROFILES, Profile
from tests.drivers.bus.wire import MS, Wire, wired

LEVELS = 16
TIMEOUT_MS = 20.0
LATE, LOST = 0.03, 0.003
STREAM_NS = 3 * MS
"""Highest age of a stream value at its arrival: the slowest sends every 2 ms, at ticks of 1 ms."""


def level_um(level: int) -> float:
    """Return the displacement at a level, in µm."""
    return 1.0 + level


def level_out(level: int) -> float:
    """Return the value of a level, in the output's unit; all devices allow it."""
    return 0.25 + 0.28 * level


class Trial:
    """A driver that is used again and again, with known correct values.

    Attributes:
        accepted: Number of accepted values.
        wrong: The wrong ones, by the call.
    """

    def __init__(self, profile: Profile, wire: Wire, seed: int) -> None:
        self._wire = wire
        self._random = random.Random(seed)  # noqa: S311 - repeatable
        self._n_outputs, self._streams = len(profile.wiring.outputs), profile.streams
        self._device: Any = profile.maker("127.0.0.1:1", TIMEOUT_MS)()
        self._device.open()
        self._device.activate(wire.now_ns)
        self._able = self._device.capabilities()
        self.accepted: Counter[str] = Counter()
        self.wrong: list[tuple[str, object, object]] = []
        self._levels: list[tuple[int, int]] = []
        self._at = 0
        self._read = [self._learn_read(level) for level in range(LEVELS)]
        self._driven = [self._learn_driven(level) for level in range(LEVELS)]

    def transactions(self, count: int) -> None:
        """Send this number of requests, with some of the replies late."""
        calls = [self._read_one] if self._able.inputs else []
        calls += [self._write_one] if self._able.outputs else []
        calls += [self._read_back_one] if self._able.outputs and self._able.read_back else []
        self._wire.late, self._wire.lost = (0.0 if self._streams else LATE), LOST
        end = self._wire.sent + count
        for _ in range(count if self._streams else 40 * count):
            self._random.choice(calls)()
            self._wire.wait(self._random.randrange(2 * MS))
            if self._wire.sent >= end:
                break
        self._device.close()

    def _move(self, level: int) -> None:
        self._levels = [*self._levels[-50:], (self._wire.now_ns, level)]
        self._wire.rig.at_um = [level_um(level)] * len(self._wire.rig.at_um)

    def _learn_read(self, level: int) -> float:
        self._move(level)
        if not self._able.inputs:
            return 0.0
        for _ in range(3):
            self._wire.wait(100 * MS)
            sample = self._device.read(self._wire.now_ns)[0]
        assert sample.valid
        return float(sample.position_um)

    def _learn_driven(self, level: int) -> tuple[float, float]:
        if not self._able.outputs:
            return 0.0, 0.0
        assert self._write(level)
        self._wire.wait(100 * MS)
        self._device.write([level_out(level)] * self._n_outputs, self._wire.now_ns)
        self._wire.wait(100 * MS)
        readings = self._device.read_back(self._wire.now_ns)[0]
        return self._wire.rig.drive_v[0], float(readings)

    def _write(self, level: int) -> bool:
        taken: bool = self._device.write([level_out(level)] * self._n_outputs, self._wire.now_ns)
        return taken

    def _read_one(self) -> None:
        self._move(self._random.randrange(LEVELS))
        sample = self._device.read(self._wire.now_ns)[0]
        if sample.valid:
            right = self._levels_since(sample.t_ns)
            self._judge("read", sample.position_um, right, self._read)

    def _levels_since(self, t_ns: int) -> list[float]:
        """Return the values that may be read of an axis with these levels since an instant."""
        t_ns -= STREAM_NS if self._streams else 0
        at_first = [level for at_ns, level in self._levels if at_ns <= t_ns][-1:]
        since = [level for at_ns, level in self._levels if at_ns > t_ns]
        return [self._read[level] for level in (*at_first, *since)]

    def _write_one(self) -> None:
        level = self._random.randrange(LEVELS)
        if self._write(level):
            driven = [each[0] for each in self._driven]
            self._judge("write", self._wire.rig.drive_v[0], [driven[level]], driven)

    def _read_back_one(self) -> None:
        value = self._device.read_back(self._wire.now_ns)[0]
        if value - value == 0.0:
            driven_v = self._wire.rig.drive_v[0]
            readings = [each[1] for each in self._driven if abs(each[0] - driven_v) < 1e-9]
            if readings:
                self._judge("read_back", value, readings, [each[1] for each in self._driven])

    def _judge(self, call: str, value: float, right: list[float], known: list[float]) -> None:
        self.accepted[call] += 1
        near = (max(known) - min(known)) / (LEVELS - 1) / 2
        if not any(abs(value - each) <= near for each in right):
            self.wrong.append((call, value, right))


def _try(profile: Profile, transactions: int) -> Trial:
    with wired(profile, TIMEOUT_MS) as wire:
        trial = Trial(profile, wire, 1)
        trial.transactions(transactions)
    return trial


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.name)
@pytest.mark.few(9)
def test_no_late_reply_is_taken_for_another(profile: Profile) -> None:
    """While the device moves all the time, no accepted value is wrong."""
    trial = _try(profile, 1000)

    assert trial.wrong == []
    assert trial.accepted.total() > 350


@pytest.mark.stress
@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.name)
def test_no_late_reply_of_100_000_is(profile: Profile, figure: Figure) -> None:
    """The same holds for 100000 replies; a stream is in time, as its late values have no age."""
    trial = _try(profile, 100_000)
    accepted = ", ".join(f"{count} by {call}" for call, count in sorted(trial.accepted.items()))
    figure(f"late replies, {profile.name}: {len(trial.wrong)} wrong values of {accepted}")

    assert trial.wrong == []
