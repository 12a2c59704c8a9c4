"""How answers look in a notebook."""

from collections.abc import Iterable, Sequence
from html import escape


def html_table(line: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a line of text and a table below it, as HTML."""
    head = "".join(f"<th>{escape(each)}</th>" for each in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>{escape(line)}</p>{table}"
