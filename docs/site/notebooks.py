"""Notebooks as pages: their text and their code, without outputs, which they do not store."""

import json
from collections.abc import Iterator
from pathlib import Path


def notebook_page(notebook: Path) -> str:
    """Return the Markdown of a notebook."""
    return "\n".join(_page(notebook)) + "\n"


def _page(notebook: Path) -> Iterator[str]:
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        text = "".join(cell["source"])
        yield f"```python\n{text}\n```\n" if cell["cell_type"] == "code" else f"{text}\n"
        if number == 0:
            # As HTML: a link in Markdown would lead to this page.
            yield f'<a href="{notebook.name}" download>Download the notebook</a>\n'
