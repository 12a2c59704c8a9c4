"""The dashboard, the alert rules and the page name metrics that the daemon has."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from piezod.daemon.loop import accept
from tests.daemon.bench import Bench

DOCS = Path(__file__).parents[3] / "docs"
METRIC = re.compile(r"\bpiezod_\w+")
DERIVED = {
    "counter": ("_total",),
    "histogram": ("_bucket", "_sum", "_count"),
    "gauge": ("",),
}
"""Names of samples, after the name of a metric without `_total`."""


@pytest.fixture
def metrics(tmp_path: Path, rig_file: Path) -> Iterator[dict[str, str]]:
    """Return the metrics of a stage: their types by name, without `_total`."""
    bench = Bench(tmp_path, accept.load(rig_file))
    text = bench.link.metrics(lease_held=False, openmetrics=False).decode()
    yield {family.name: family.type for family in text_string_to_metric_families(text)}
    bench.link.stage_audit.close()


def queries_of(part: Any) -> Iterator[str]:
    """Yield the queries in a dashboard or a file of rules."""
    if isinstance(part, dict):
        for key, each in part.items():
            if key in {"expr", "query"} and isinstance(each, str):
                yield each
            yield from queries_of(each)
    elif isinstance(part, list):
        for each in part:
            yield from queries_of(each)


@pytest.mark.parametrize("file", ["dashboard.json", "alerts.yaml"])
def test_queries_name_metrics_that_exist(metrics: dict[str, str], file: str) -> None:
    """Each metric in a query of the dashboard and of the rules is one of the daemon."""
    samples = {name + end for name, kind in metrics.items() for end in DERIVED[kind]}
    text = (DOCS / "monitoring" / file).read_text(encoding="utf-8")
    document = json.loads(text) if file.endswith("json") else yaml.safe_load(text)
    named = [METRIC.findall(query) for query in queries_of(document)]

    assert sum(map(len, named)) >= 8
    assert {name for names in named for name in names} <= samples


def test_page_describes_all_metrics(metrics: dict[str, str]) -> None:
    """The table of the page has each metric, with the type and no others."""
    page = (DOCS / "monitoring.md").read_text(encoding="utf-8")
    table = page.partition("## The metrics")[2]
    rows = re.findall(r"^\| (`.+`) \| (\w+) \|", table, re.MULTILINE)
    described = {
        f"piezod_{name.removesuffix('_total')}": kind.replace("info", "gauge")
        for cell, kind in rows
        for name in re.findall(r"`(\w+)(?:\{[\w,]+\})?`", cell)
    }

    assert described == metrics
