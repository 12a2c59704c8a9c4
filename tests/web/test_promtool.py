"""The metrics and the alert rules, checked by the tool of Prometheus."""

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from piezod.web.metrics import joined
from tests.daemon.daemons import NO_TLS, Daemon, configuration
from tests.forked import forked
from tests.web.browser import Browser

RULES: Final = Path(__file__).parents[2] / "docs" / "monitoring" / "alerts.yaml"
NOTICED: Final = "PiezodPageDown|PiezodNoStage|PiezodStageMissing"
PromTool = Callable[..., str]


@pytest.fixture
def promtool() -> PromTool:
    """Return a function that runs promtool with arguments and input; it returns what it finds."""
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("no promtool in PATH: install the package `prometheus`")

    def run(*arguments: str, text: str = "") -> str:
        done = subprocess.run(
            [program, *arguments], input=text, capture_output=True, text=True, check=False
        )
        return "" if done.returncode == 0 else done.stdout + done.stderr

    return run


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig"."""
    with Daemon(configuration(tmp_path)) as daemon:
        yield daemon.up()


def metrics_of(daemon: Daemon) -> str:
    """Return the metrics of a stage in the format that promtool reads."""
    transport = httpx.HTTPTransport(uds=str(daemon.paths.api_socket), verify=NO_TLS)
    with httpx.Client(transport=transport, base_url="http://stage", timeout=20) as client:
        return client.get("/v1/metrics", headers={"Accept": "text/plain"}).text


def test_metrics_are_as_prometheus_wants_them(
    promtool: PromTool, daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names, types and help texts of a stage, and of all stages of the page, have no fault."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
    one = metrics_of(daemon)
    with forked("web", "--port", "0") as process:
        url = urlsplit(process.stdout.readline().strip())
        browser = Browser(url.port or 0, parse_qs(url.query)["token"][0])
        page = browser.request("GET", f"/metrics?token={browser.token}").text
    two = joined([one, one.replace('stage="rig"', 'stage="other"')])

    assert 'piezod_healthy{stage="rig"}' in page
    assert 'piezod_healthy{stage="other"}' in two
    assert [promtool("check", "metrics", text=text) for text in (one, page, two)] == [""] * 3


def test_faults_of_metrics_are_found(promtool: PromTool) -> None:
    """A metric without a help text is a finding: the check above can fail."""
    assert "no help text" in promtool("check", "metrics", text="# TYPE a gauge\na 1\n")


def test_alert_rules_are_valid(promtool: PromTool) -> None:
    """Prometheus takes the rules of the documentation."""
    assert promtool("check", "rules", str(RULES)) == ""


@pytest.mark.parametrize(
    ("alert", "series"),
    [
        ("PiezodPageDown", {'up{job="piezod"}': "1x5 0x20", 'piezod_healthy{stage="a"}': "1x25"}),
        ("PiezodNoStage", {'up{job="piezod"}': "1x25"}),
        ("PiezodStageMissing", {'piezod_healthy{stage="a"}': "1x5 stale",
                                'piezod_healthy{stage="b"}': "1x25"}),
    ],
)  # fmt: skip
def test_missing_metrics_of_a_page_raise_an_alert(
    promtool: PromTool, tmp_path: Path, alert: str, series: dict[str, str]
) -> None:
    """A page that is scraped has no file that grows old: other rules notice that it is gone."""
    ask = {"expr": f'count by (alertname) (ALERTS{{alertstate="firing", alertname=~"{NOTICED}"}})'}
    file = tmp_path / "history.yaml"
    history = {
        "input_series": [{"series": name, "values": text} for name, text in series.items()],
        "promql_expr_test": [
            {**ask, "eval_time": "20m",
             "exp_samples": [{"labels": f'{{alertname="{alert}"}}', "value": 1}]},
        ],
    }  # fmt: skip
    file.write_text(json.dumps({"rule_files": [str(RULES)], "evaluation_interval": "1m",
                                "tests": [{"interval": "1m", **history}]}))  # fmt: skip

    assert promtool("test", "rules", str(file)) == ""
