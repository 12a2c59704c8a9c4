"""Which quota of processor time holds for a process."""

from pathlib import Path

import pytest

from piezod.cli.experiment import processor_warnings
from piezod.cli.experiment.processor_quota import Quota, processor_quota


def quota(folder: Path, own: str, **files: str) -> Quota | None:
    """Return the quota with these files; `__` in a name stands for a slash, `_D_` for a dot."""
    for name, text in files.items():
        path = folder / "groups" / name.replace("__", "/").replace("_D_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (folder / "own").write_text(own, encoding="utf-8")
    return processor_quota(folder / "own", folder / "groups")


def test_smallest_quota_of_all_groups_around_it_holds(tmp_path: Path) -> None:
    """A group is limited by each group that it is in."""
    files = {"cpu_D_max": "max 100000\n", "a__cpu_D_max": "30000 100000\n"}
    found = quota(tmp_path, "0::/a/b\n", **files, a__b__cpu_D_max="200000 100000\n")
    assert found == pytest.approx((0.03, 0.1))


def test_quota_of_the_older_groups(tmp_path: Path) -> None:
    """Version 1 has a file for each number, and -1 for no quota."""
    files = {"cpu__a__cpu_D_cfs_quota_us": "50000\n", "cpu__a__cpu_D_cfs_period_us": "100000\n"}
    assert quota(tmp_path, "4:cpu,cpuacct:/a\n0::/\n", **files) == pytest.approx((0.05, 0.1))
    files["cpu__a__cpu_D_cfs_quota_us"] = "-1\n"
    assert quota(tmp_path, "4:cpu,cpuacct:/a\n", **files) is None


@pytest.mark.parametrize("text", ["max 100000", "", "x y", "1", "1 2 3", "5 0"])
def test_no_quota(tmp_path: Path, text: str) -> None:
    """Without a number there is no quota, and without files, too."""
    assert quota(tmp_path, "0::/a\n", a__cpu_D_max=text) is None
    assert processor_quota(tmp_path / "none", tmp_path) is None


def test_check_warns_of_a_quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The warning of `check` names the number of processors and how long the loop stands still."""
    monkeypatch.setattr(processor_warnings, "processor_quota", lambda: Quota(0.03, 0.1))
    monkeypatch.setattr(processor_warnings, "running_stages", lambda: {"stage": ""})
    (warning,) = processor_warnings.processor_warnings(tmp_path / "stage.yaml")
    assert "0.3 processors" in warning
    assert "70 ms" in warning
