"""The processor time that the control group of this process may use."""

from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

_GROUPS: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")


class Quota(NamedTuple):
    """A limit: a group that has used it up stands still for the rest of the period."""

    used_s: float  #: Processor time per period, in s.
    period_s: float  #: The period, in s.

    @property
    def processors(self) -> float:
        """The number of processors that it equals."""
        return self.used_s / self.period_s


def processor_quota(own: Path = _OWN, groups: Path = _GROUPS) -> Quota | None:
    """Return the smallest quota of the groups that this process is in, None if there is none.

    Args:
        own: File with the paths of the groups, as /proc/self/cgroup.
        groups: Folder of all groups.
    """
    quotas = []
    with suppress(OSError):
        for line in own.read_text(encoding="utf-8", errors="replace").splitlines():
            _, kinds, path = line.split(":", 2)
            if kinds == "":
                top, read = groups, _quota_v2
            elif "cpu" in kinds.split(","):
                top, read = groups / "cpu", _quota_v1
            else:
                continue
            # A limit of a group holds for all groups inside it.
            group = top / path.lstrip("/")
            quotas += [read(each) for each in (group, *group.parents) if each.is_relative_to(top)]
    return min(filter(None, quotas), key=lambda each: each.processors, default=None)


def _quota_v2(group: Path) -> Quota | None:
    used_us, _, period_us = _text(group / "cpu.max").partition(" ")
    return _quota(used_us, period_us)


def _quota_v1(group: Path) -> Quota | None:
    return _quota(_text(group / "cpu.cfs_quota_us"), _text(group / "cpu.cfs_period_us"))


def _quota(used_us: str, period_us: str) -> Quota | None:
    """Return the quota of two numbers; None for "max", -1, or a missing file."""
    if not (used_us.isdecimal() and period_us.isdecimal() and int(period_us)):
        return None
    return Quota(int(used_us) * 1e-6, int(period_us) * 1e-6)


def _text(file: Path) -> str:
    with suppress(OSError):
        return file.read_text(encoding="utf-8").strip()
    return ""
