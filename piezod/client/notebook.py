"""How results look in a notebook."""

from collections.abc import Iterable, Sequence
from html import escape


def html_table(
    line: str, headings: Sequence[str], rows: Iterable[Sequence[str | float | None]]
) -> str:
    """Return a line of text and a table as HTML; numbers have three decimals, None is a dash.

    Args:
        line: The text above the table.
        headings: Headings of the columns.
        rows: The rows, as long as the headings.
    """
    head = "".join(f"<th>{escape(each)}</th>" for each in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(_cell(each))}</td>' for each in row)}</tr>" for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>{escape(line)}</p>{table}"


def _cell(value: str | float | None) -> str:
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.3f}"
