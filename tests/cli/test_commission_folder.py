"""`piezod commission`: where its results are."""

from io import StringIO
from pathlib import Path

import pytest

from piezod.commission import bench
from piezod.testing.fake_clock import FakeClock
from tests.cli.conftest import Command

SHIPPED = Path(__file__).parents[2] / "config" / "simulated.yaml"


@pytest.mark.parametrize("out", [(), pytest.param(("--out", "mine"), marks=pytest.mark.stress)])
def test_commission_replaces_nothing(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch, out: tuple[str, ...]
) -> None:
    """A second run has a folder of its own, also where somebody else has put a link."""
    monkeypatch.setattr(bench, "MonotonicClock", lambda: FakeClock(1_000_000_000))
    monkeypatch.setattr("piezod.commission.sheet.draw", lambda _: iter(()))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    name = out[-1] if out else "simulated-x-commissioned"
    (folder / "elsewhere").mkdir()
    (folder / f"{name}-2").symlink_to(folder / "elsewhere")
    for _ in range(2):
        monkeypatch.setattr("sys.stdin", StringIO("y\nn\n"))
        assert piezod("commission", str(SHIPPED), *out).code == 0
    sheets = sorted(path.parent.name for path in folder.rglob("acceptance.html"))

    assert sheets == [name, f"{name}-3"]
    assert list((folder / "elsewhere").iterdir()) == []
