"""The acceptance sheet: one HTML page to print and sign, with the data beside it."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from piezod.commission.figures import draw
from piezod.commission.noise import DURATION_S
from piezod.commission.procedure import Findings
from piezod.devices.interface import Identity
from piezod.records.atomic import replacing
from piezod.records.csv_file import write_csv
from piezod.records.page import render

SHEET_NAME: Final = "acceptance.html"


class SheetRow(NamedTuple):
    """A row of the table of results."""

    name: str
    value: str
    unit: str
    how: str


class Sheet(NamedTuple):
    """Content of the page."""

    axis: str  #: Name of the axis.
    facts: Mapping[str, str]  #: Names and values below the headline.
    identities: Mapping[str, Identity]  #: Identities of the devices.
    findings: Findings  #: The results.
    not_done: Sequence[str]  #: Names of the steps that were left out, or ended in an error.
    profile_name: str  #: Name of the file with the configuration.
    profile: str  #: Text of that file.


def write_sheet(folder: Path, sheet: Sheet) -> Path:
    """Write the page, its configuration, and the records as CSV.

    Returns:
        Path of the page.

    Raises:
        OSError: If the files cannot be written.
    """
    for name, trace in sheet.findings.traces.items():
        columns = {
            "t_s": trace.t_s,
            "drive_v": trace.drive_v,
            "position_um": trace.position_um,
            "read_back_v": trace.read_back_v,
        }
        write_csv(folder / f"{name}.csv", columns)
    if sheet.profile:
        with replacing(folder / sheet.profile_name) as temporary:
            temporary.write_text(sheet.profile, encoding="utf-8")
    page = render(
        "acceptance.html.jinja",
        {},
        **sheet._asdict(),
        rows=list(rows_of(sheet.findings)),
        figures=list(draw(sheet.findings)),
    )
    with replacing(folder / SHEET_NAME) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return folder / SHEET_NAME


def rows_of(findings: Findings) -> Iterator[SheetRow]:
    """Yield the results, one row per quantity."""
    if noise := findings.noise:
        at_rest = f"{DURATION_S:g} s at rest"
        yield SheetRow("noise", f"{noise.rms_um * 1e3:.2f}", "nm rms", at_rest)
        yield SheetRow("drift", f"{noise.drift_um_per_s * 1e3:+.2f}", "nm/s", at_rest)
        yield SheetRow("valid samples", f"{noise.valid_pct:.1f}", "%", at_rest)
    if polarity := findings.polarity:
        way = "rises" if polarity.um_per_v > 0 else "falls"
        yield SheetRow("polarity", way, "", f"steps of {polarity.step_v:+.2f} V")
    if travel := findings.travel:
        ends = f"{travel.drive_low_v:.1f} to {travel.drive_high_v:.1f} V"
        yield SheetRow("travel", f"{abs(travel.travel_um):.3f}", "µm", ends)
        yield SheetRow("gain", f"{travel.um_per_v * 1e3:.2f}", "nm/V", f"mean over {ends}")
        yield SheetRow("width of the loop", f"{travel.loop_pct:.2f}", "% of travel", ends)
        yield SheetRow("noise", f"{travel.noise_pct:.3f}", "% of travel", "over the travel")
    if amplifier := findings.amplifier:
        how = "line through the read-back over the written voltage"
        yield SheetRow("gain of the amplifier", f"{amplifier.gain:.5f}", "V/V", how)
        yield SheetRow("offset of the amplifier", f"{amplifier.offset_v:+z.4f}", "V", how)
        yield SheetRow("its largest deviation", f"{amplifier.worst_v:.4f}", "V", how)
    if response := findings.response:
        value = f"{response.delay_s * 1e3:.3f} ± {response.uncertainty_s * 1e3:.3f}"
        value = value if response.found else "none found"
        yield SheetRow(
            "delay", value, "ms" if response.found else "", "slope of the phase of small sines"
        )
    if ringing := findings.ringing:
        how = f"ringing after small steps, searched up to {ringing.searched_hz:g} Hz"
        found = f"{ringing.frequency_hz:.1f}" if ringing.found else "none found"
        yield SheetRow("first mode", found, "Hz" if ringing.found else "", how)
        if ringing.found:
            yield SheetRow("its damping ratio", f"{ringing.damping:.4f}", "", how)
