"""Formulas as MathML: browsers show it without a script, and nothing is loaded for it."""

import re
from html import unescape
from typing import Final

from latex2mathml.converter import convert

_FORMULA: Final = re.compile(
    r'<(span|div) class="arithmatex">\s*\\[(\[](.*?)\\[)\]]\s*</\1>', re.DOTALL
)
"""A formula as `pymdownx.arithmatex` leaves it."""


def with_mathml(html: str) -> str:
    """Return the HTML of a page with its formulas in MathML."""
    return _FORMULA.sub(_mathml, html)


def _mathml(formula: re.Match[str]) -> str:
    display = "block" if formula[1] == "div" else "inline"
    mathml: str = convert(unescape(formula[2]).strip(), display=display)
    return f'<div class="formula">{mathml}</div>' if display == "block" else mathml
