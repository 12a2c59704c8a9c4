"""The reference pages of the site are made from the code, and complete."""

import re
from pathlib import Path

import pytest

from docs.site.links import DOCS, ROOT
from docs.site.navigation import listed, navigation
from docs.site.reference import REFERENCE, UPGRADE, keys, reference_pages
from docs.site.reference.http import openapi
from piezod.client import StageClient
from piezod.config.daemon import DaemonConfig
from piezod.config.experiment import ExperimentConfig
from piezod.control.faults.table import FAULTS
from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN
from piezod.devices import registry
from piezod.ioc.motor_fields import FIELDS
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS
from piezod.messages.requests import TABLE
from piezod.telemetry.descriptions import descriptions
from tests.command_table import CONNECTION, usage_of_verbs

LINK = re.compile(r"\]\(#([^)]+)\)")
ANCHOR = re.compile(r"\{ #(\S+) \}")
NO_MEANING = re.compile(r"^\| `\w+` \|.*\| +\|$", re.MULTILINE)


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    """Return the pages."""
    return reference_pages()


@pytest.mark.parametrize(
    ("uri", "model"),
    [("reference/stage.md", DaemonConfig), ("reference/experiment.md", ExperimentConfig)],
)
def test_every_key_has_a_row_with_its_meaning(
    pages: dict[str, str], uri: str, model: type[DaemonConfig | ExperimentConfig]
) -> None:
    """The pages about configurations have all keys, and say what each means."""
    rows = set(re.findall(r"^\| `(\w+)` \|", pages[uri], re.MULTILINE))
    names = {name for each in keys.reachable(model) for name in each.model_fields}

    assert names == rows
    assert NO_MEANING.findall(pages[uri]) == []


def test_numbers_have_unit_range_and_default(pages: dict[str, str]) -> None:
    """A row has the unit, the range and the default of its key."""
    start = "| `ramp_v_per_s` | V/s | 0.1 to 1000000 | `50` |"
    row = f"{start} Rate of the ramp to the safe voltage, V/s. |"

    assert row in pages["reference/stage.md"].splitlines()


def test_options_of_all_drivers_are_described(pages: dict[str, str]) -> None:
    """Each driver has a section, and no option is without its meaning or its range."""
    page = pages["reference/drivers.md"]

    assert [name for name in registry.names() if f"## `{name}`" not in page] == []
    assert NO_MEANING.findall(page) == []
    assert "| value |" not in page


def test_all_commands_methods_and_endpoints_are_described(pages: dict[str, str]) -> None:
    """Each has a section of its own."""
    methods = {name for name in dir(StageClient) if name[0] != "_"} - set(CONNECTION)
    paths = {(method.upper(), path) for path, all_ in openapi()["paths"].items() for method in all_}

    for verb in usage_of_verbs():
        assert f"### `piezod {verb}`" in pages["reference/commands.md"]
    for name in methods - {"name", "socket"}:
        assert f"### `{name}`" in pages["reference/client.md"]
    for method, path in paths:
        assert f"## `{method} {path}`" in pages["reference/http.md"]
    assert paths == {(row.method, f"/v1/{row.path}") for row in TABLE.values()}


def test_all_faults_and_columns_are_described(pages: dict[str, str]) -> None:
    """Each fault has its remedy, each column its description."""
    for rule in FAULTS:
        section = pages["reference/faults.md"].partition(f"### {rule.id} ")[2].partition("###")[0]
        assert rule.remedy[1:] in section
        assert {**NEVER_SHOWN, **GAPS}.get(rule.id, "") in section
    for name, text in descriptions().items():
        assert f"| `{name}` |" in pages["reference/recordings.md"]
        assert text[1:].rstrip(".") in pages["reference/recordings.md"]


def test_all_epics_records_are_described(pages: dict[str, str]) -> None:
    """The page has every record of an axis and of the stage, and every field of a motor record."""
    page = pages["reference/epics.md"]
    names = {record.name for record in (*AXIS_RECORDS, *STAGE_RECORDS)}
    names |= {field.name for field in FIELDS}

    assert [name for name in names if f"`{name}`" not in page] == []


def test_upgrade_notes_have_what_users_must_change(pages: dict[str, str]) -> None:
    """What the changelog says about upgrading is there, what else it says is not."""
    notes, _, upgrading = (ROOT / "CHANGELOG.md").read_text("utf-8").partition("### Upgrading\n\n")

    assert upgrading.partition("\n")[0] in pages[UPGRADE]
    assert notes.strip().splitlines()[-1] not in pages[UPGRADE]


def test_links_within_a_page_lead_somewhere(pages: dict[str, str]) -> None:
    """Every anchor that a page links is one of its sections."""
    for text in pages.values():
        assert set(LINK.findall(text)) <= set(ANCHOR.findall(text))


def test_all_pages_are_in_the_navigation(pages: dict[str, str]) -> None:
    """The table of contents and the generated pages are the navigation: each page, once."""
    text = str(navigation())
    all_pages = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}

    assert [
        uri for uri in (*REFERENCE.values(), UPGRADE, *all_pages) if f"'{uri}'" not in text
    ] == []
    contents = listed()
    assert [path for path in contents if not (ROOT / path).exists()] == []
    assert len(contents) == len(set(contents))
    assert set(pages) == {*REFERENCE.values(), UPGRADE}


def test_gallery_shows_all_images() -> None:
    """Each image of the documentation is in the gallery."""
    gallery = (DOCS / "measurements.md").read_text(encoding="utf-8")

    assert [path.name for path in Path(DOCS / "images").iterdir() if path.name not in gallery] == []
