"""`piezod identify`: gaps of the record, and a drive without them."""

import json
from pathlib import Path

import pytest

from piezod.experiment.fit.excitation import recommended_drive
from tests.cli.conftest import Command
from tests.experiment.fit.test_excitation import followed, recommended
from tests.experiment.made_up import record_of, sine, write_record

OPTIONS = ("--delay-s", 0, "--order", 3)


@pytest.fixture
def poor(folder: Path) -> Path:
    """Return a data file of full swings of one frequency."""
    write_record(folder / "poor.csv", record_of(path=sine))
    return Path("poor.csv")


@pytest.fixture
def rich(folder: Path) -> Path:
    """Return a data file of the recommended drive."""
    write_record(folder / "rich.csv", followed(recommended(0.0, 148.0)))
    return Path("rich.csv")


def test_gaps_are_listed_with_a_drive_to_paste(piezod: Command, poor: Path) -> None:
    """The gaps are listed, and a drive without them is printed without line breaks."""
    out = piezod("identify", "--verbose", poor, *OPTIONS).out

    assert "- Swings of 10 to 20 % of the range, 3 to 6 µm: none, 2 are needed." in out
    (block,) = out.split("\nidentification:\n")[1:]
    high_v = float(block.split("high: ")[1].split(",")[0])
    assert recommended_drive(0.0, high_v).split("identification:\n")[1] in block


def test_a_complete_record_gets_one_line(piezod: Command, rich: Path) -> None:
    """For a complete record no drive is recommended."""
    out = piezod("identify", "--verbose", rich, *OPTIONS).out

    assert "The record has swings of all sizes and speeds that the model needs." in out
    assert "identification:" not in out


def test_document_holds_both(piezod: Command, poor: Path, rich: Path) -> None:
    """The document has the gaps and the drive."""
    of_poor, of_rich = (
        json.loads(piezod("identify", "--verbose", data, *OPTIONS, "--json").out)["excitation"]
        for data in (poor, rich)
    )

    assert len(of_poor["missing"]) == 5
    assert of_poor["recommended"].startswith("identification:\n  method: surface # ")
    assert of_rich == {"missing": [], "recommended": recommended_drive(0.0, 148.0)}
