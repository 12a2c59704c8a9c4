"""The hooks of mkdocs: navigation, links out of `docs/`, pages made from the code, and formulas.

The pages themselves are plain Markdown, as a forge shows them.
"""

import re
from typing import Any, Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from docs.site.formulas import with_mathml
from docs.site.links import Repository
from docs.site.navigation import navigation
from docs.site.reference import reference_pages

_LABELLED_FENCE: Final = re.compile(r"^( *```python) \w+$", re.MULTILINE)
"""`python sdk`: the second word tells a test in which file the code belongs."""
_repository = Repository()


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Take the navigation from the table of contents, `docs/README.md`."""
    config.nav = navigation()
    return config


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the reference, and what the pages link outside `docs/`."""
    for uri, text in {**reference_pages(), **_repository.pages()}.items():
        files.append(File.generated(config, uri, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Lead links to the pages of the site."""
    text = _LABELLED_FENCE.sub(r"\1", markdown)
    return _repository.relinked(text, page.file.src_uri)


def on_page_content(html: str, **_: Any) -> str:
    """Replace formulas by MathML, which browsers show without a script."""
    return with_mathml(html)
