"""The voltages of the last cycles, so that a sample is paired with the voltage it answers to."""


class DriveHistory:
    """A ring of the voltages that were in force, one entry per cycle; nothing grows.

    Between entries the voltage is interpolated linearly, as it is for recorded data: a delay that
    was identified from a record means the same here.

    Args:
        in_force_v: Voltage in force before the first entry, in V.
        entries: Cycles remembered; older times get the oldest voltage.
    """

    def __init__(self, in_force_v: float, entries: int) -> None:
        self._t_ns = [0] * entries
        self._drive_v = [in_force_v] * entries
        self._newest = 0
        self._empty = True

    def append(self, t_ns: int, drive_v: float) -> None:
        """Note the voltage in force at an instant, later than all before; call it in the loop."""
        if self._empty:
            self._t_ns = [t_ns] * len(self._t_ns)
            self._empty = False
        self._newest = (self._newest + 1) % len(self._t_ns)
        self._t_ns[self._newest] = t_ns
        self._drive_v[self._newest] = drive_v

    def at(self, t_ns: int) -> float:
        """Return the voltage that was in force at an instant, in V; may be called in the loop."""
        later = self._newest
        for back in range(len(self._t_ns)):
            index = self._newest - back
            if self._t_ns[index] <= t_ns:
                return self._between(index, later, t_ns)
            later = index
        return self._drive_v[later]

    def _between(self, earlier: int, later: int, t_ns: int) -> float:
        span_ns = self._t_ns[later] - self._t_ns[earlier]
        if span_ns <= 0:
            return self._drive_v[earlier]
        part = (t_ns - self._t_ns[earlier]) / span_ns
        return self._drive_v[earlier] + (self._drive_v[later] - self._drive_v[earlier]) * part
