"""Self-contained HTML pages from the templates of this package."""

from collections.abc import Callable, Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def render(template: str, filters: Mapping[str, Callable[..., Any]], /, **context: Any) -> str:
    """Return a page.

    Args:
        template: Name of its template.
        filters: Filters of the template, in addition to jinja's own.
        **context: Variables of the template.
    """
    environment = Environment(
        loader=PackageLoader("piezod.records"),
        autoescape=True,
        undefined=StrictUndefined,  # a misspelt variable raises an error and is not left blank
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= dict(filters)
    return environment.get_template(template).render(context)
