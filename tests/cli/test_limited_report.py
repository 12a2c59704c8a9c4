"""Refusals on stderr are bounded."""

from piezod.cli.daemon.limited_report import MOST_LINES, WINDOW_S, LimitedReport


def test_flood_of_refusals_is_cut() -> None:
    """The first lines of a window are printed, then how many were left out."""
    lines: list[str] = []
    now_s = 0.0
    report = LimitedReport(lines.append, lambda: now_s)
    for _ in range(1000):
        report("refused")
    now_s = WINDOW_S
    report("again")

    assert lines[:-2] == ["refused"] * MOST_LINES
    assert (lines[-1], str(1000 - MOST_LINES) in lines[-2]) == ("again", True)
