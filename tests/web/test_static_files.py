import re
from pathlib import Path

import pytest

import piezod.web
from piezod.web.app import SHOWN_SCRIPT

STATIC = Path(piezod.web.__file__).parent / "static"
MODULES = sorted(STATIC.glob("*.js"))
MOST_LINES = 300


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.name)
def test_module_imports_what_there_is(module: Path) -> None:
    """Each module is short, and each file and each name that it imports exists."""
    text = module.read_text()
    imports = re.findall(r"^import \{([^}]*)\} from \"(\./[^\"]+)\"", text, re.M)
    files = re.findall(r"(?:from |import\(|open\()\"(\./[^\"]+)\"", text)

    assert len(text.splitlines()) <= MOST_LINES
    for names, file in [*imports, *(("", file) for file in files)]:
        script = SHOWN_SCRIPT if file == "./shown.js" else (STATIC / file).read_text()
        exported = re.findall(r"^export (?:async )?(?:function|class|const) (\w+)", script, re.M)
        wanted = {name.split(" as ")[0].strip() for name in names.split(",") if name.strip()}
        assert wanted <= set(exported), f"{module.name} imports from {file}"


def test_page_has_nothing_inline() -> None:
    """The page has no inline script and no inline style, and all its files exist."""
    page = (STATIC / "index.html").read_text()

    files = re.findall(r"(?:href|src)=\"static/([^\"]+)\"", page)
    assert len(files) >= 5
    assert all((STATIC / file).is_file() for file in files)
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script(?![^>]*\ssrc=)", page)


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.name)
def test_script_sets_no_style_attribute(module: Path) -> None:
    """No script makes markup from text or sets a style attribute, which the policy refuses."""
    text = module.read_text()

    assert not re.search(r"innerHTML|insertAdjacentHTML|outerHTML|\"style\"|\bstyle: \"", text)
