"""The regular expressions that are allowed for replies."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod_drivers.serial_line.ascii_line.patterns import compiled


@pytest.mark.parametrize(
    "pattern",
    [
        "Ok",
        r"(?P<x>[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?) um",
        r"(?P<x>-?\d+\.\d+),(?P<y>-?\d+\.\d+)",
        r"\s*(?P<x>[-+\d.eE]+)\s*",
        ".*OVERLOAD.*",
        ".*?X",
        r".*-?\d+",
        r"(?:\d+,)*\d+",
        r"ERR|OK|E\d+",
        "[^,]*,(?P<x>[0-9]{1,5}).*",
        r"\d{5}",
        r"T=\d+\xb0C",
        r"[]a]+[\]]x",
        "(ab)?c",
    ],
)
def test_usual_patterns_are_allowed(pattern: str) -> None:
    """Numbers, fields between commas, alternatives and one .* are allowed."""
    assert compiled(pattern).pattern == pattern


@pytest.mark.parametrize(
    ("pattern", "what"),
    [
        ("(a+)+b", "so is the group around it"),
        (r"(\d+)*", "so is the group around it"),
        ("((a*))*", "may match the empty text"),
        (r"(?:x?\d*)+", "may match the empty text"),
        ("(?:a?){9}", "may match the empty text"),
        ("(a|a)*b", "may take long"),
        ("(.*a){9}", "may take long"),
        ("a?a?a?aaa", "may take long"),
        (".*,.*,.*", "may take long.*without common characters"),
        ("(?:a*b*a*c)*", "may take long"),
        ("^x", "matched as a whole"),
        ("x$", "matched as a whole"),
        (r"a\b", "not allowed"),
        ("(?=a)b", "not allowed"),
        ("(?i)a", "not allowed"),
        (r"(a)\1", "not allowed"),
        (r"\d*+", "leave out the second"),
        ("x{", "not allowed"),
        ("(", "no regular expression"),
        ("\N{SNOWMAN}", "beyond latin-1"),
    ],
)
def test_patterns_that_may_take_long_are_refused(pattern: str, what: str) -> None:
    """Nested and neighbouring ambiguities and needless constructs are refused with the remedy."""
    with pytest.raises(ValueError, match=what):
        compiled(pattern)


PIECES = ["a", "b", ".", "[ab]", "(", "(?:", ")", "|", "*", "+", "?", "{2}", "{1,3}", "*?", r"\d"]


@given(st.lists(st.sampled_from(PIECES), max_size=14).map("".join), st.sampled_from("ab1"))
def test_no_pattern_that_is_allowed_takes_long(pattern: str, char: str) -> None:
    """Allowed patterns are fast with the worst lines, even with too long ones."""
    with suppress(ValueError):
        regex = compiled(pattern)

        for line in (char * 500, char * 499 + "!", (char + "b") * 250):
            regex.fullmatch(line)


@given(st.text(max_size=30))
def test_any_text_is_a_pattern_or_refused(pattern: str) -> None:
    """Any text is a valid pattern or raises the documented error."""
    with suppress(ValueError):
        compiled(pattern)
