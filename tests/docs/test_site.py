"""The site and the notebook, in the environment of `make docs`."""

import json
import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.daemon.daemons import Daemon, configuration
from tests.docs.blocks import ROOT
from tests.docs.test_blocks import DOCS_PYTHON

pytestmark = [pytest.mark.docs, pytest.mark.timeout(600)]
LOADING = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}
"""Elements that make a browser load something, and the attribute with its address."""
LOADED_BY_STYLE = re.compile(r"url\(\s*['\"]?((?:https?:)?//[^)'\"]+)")


class Loaded(HTMLParser):
    """Collects the addresses of other hosts that a page loads from."""

    def __init__(self) -> None:
        super().__init__()
        self.foreign: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Look at one element."""
        values = dict(attrs)
        address = values.get(LOADING.get(tag, "")) or ""
        if address.startswith(("http:", "https:", "//")) and values.get("rel") != "canonical":
            self.foreign.append(address)


def run(*arguments: object, **environ: str) -> None:
    """Run Python in the environment of the documentation."""
    done = subprocess.run(
        [DOCS_PYTHON, *map(str, arguments)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", **environ},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, which is built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    config = ("--config-file", ROOT / "docs" / "site" / "mkdocs.yml")
    run("-m", "mkdocs", "--quiet", "build", "--strict", *config, "--site-dir", folder)
    return folder


def test_nothing_is_loaded_from_another_host(site: Path) -> None:
    """A browser without a network shows every page completely."""
    pages, loaded = list(site.rglob("*.html")), Loaded()
    for page in pages:
        loaded.feed(page.read_text(encoding="utf-8"))
    styles = [LOADED_BY_STYLE.findall(path.read_text("utf-8")) for path in site.rglob("*.css")]

    assert len(pages) > 50
    assert loaded.foreign == []
    assert [address for found in styles for address in found] == []


def test_formulas_are_mathml(site: Path) -> None:
    """No formula is left as text, and a browser needs no script for them."""
    page = (site / "mathematics.html").read_text(encoding="utf-8")

    assert page.count('<math xmlns="http://www.w3.org/1998/Math/MathML"') > 100
    assert "arithmatex" not in page
    assert "```" not in page


def test_pages_of_links_out_of_docs_exist(site: Path) -> None:
    """Code, configurations and folders that pages link are pages of the site."""
    for path in ("config/open-loop.yaml", "config/devices/index", "CHANGELOG", "README"):
        name = "index" if path == "README" else path
        assert (site / "project" / f"{name}.html").exists()


def test_notebook_runs(tmp_path: Path) -> None:
    """Every cell of the notebook runs against a simulated stage, and the last one draws."""
    notebook = tmp_path / "notebook.ipynb"
    shutil.copy(ROOT / "docs" / "notebook.ipynb", notebook)
    with Daemon(configuration(tmp_path)) as daemon:
        daemon.up()
        folders = {name: daemon.environ[name] for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME")}
        run("-m", "jupyter", "execute", "--inplace", notebook, **folders)
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    shown = [output.get("data", {}) for cell in cells for output in cell.get("outputs", [])]

    assert sum("image/png" in each for each in shown) == 1
    assert sum("text/html" in each for each in shown) >= 2  # the tables of `status`
    assert any("'adaptive': " in str(each.get("text/plain")) for each in shown)
