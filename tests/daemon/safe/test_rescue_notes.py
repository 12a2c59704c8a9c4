"""What a rescue makes of the notes of the last run, and what it leaves."""

from math import isnan, nan
from pathlib import Path

import pytest

from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.paths import StagePaths
from piezod.daemon.safe import rescue
from piezod.daemon.safe.ramp import AxisOutcome
from piezod.daemon.safe.ramp_down import Noted

SIMULATED = Path(__file__).parents[3] / "config" / "simulated.yaml"


@pytest.mark.parametrize("clean", [True, False])
def test_mark_of_the_run_tells_whether_it_ended_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, clean: bool
) -> None:
    """The ramp hears it; a last write that does not count any more is forgotten."""
    paths, heard = StagePaths("stage", tmp_path, tmp_path), list[bool]()
    LastOutputWriter(paths.output_map, 1).note([75.0], 1)
    if not clean:
        paths.running.touch()

    def ramped(_config: object, noted: Noted, *_: object, confirmed: bool) -> object:
        heard.append(noted.clean)
        assert not confirmed
        return {"x": AxisOutcome(75.0, False, 75.0, 75.0, "", nan)}

    monkeypatch.setattr(rescue, "ramp_down", ramped)
    rescue.Rescue(SIMULATED, paths).ramp()

    assert heard == [clean]
    assert isnan(LastOutputReader(paths.output_map).read()[0].drive_v)
