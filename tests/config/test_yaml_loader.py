"""The YAML loader: strict, bounded, and every problem with its place."""

from pathlib import Path

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from piezod.config.document import SourcePlace, format_path
from piezod.config.yaml_events import MAX_BYTES
from piezod.config.yaml_loader import MAX_DEPTH, load_yaml, parse_yaml
from piezod.errors import ConfigError


def problems_in(text: str) -> list[str]:
    """Return the problems that parsing a text finds."""
    with pytest.raises(ConfigError) as caught:
        parse_yaml(text, "f.yaml")
    return str(caught.value).splitlines()


def test_plain_data() -> None:
    """Mappings become dicts, sequences tuples; quoted words and block scalars stay texts."""
    text = "a: [1, 'x', \"1e3\"]\nb:\n  - {c: yes}\n  - |\n    12\n"

    assert parse_yaml(text, "f").data == {"a": (1, "x", "1e3"), "b": ({"c": "yes"}, "12\n")}


def test_places() -> None:
    """Keys and values have the line and column where they start, counted from 1."""
    document = parse_yaml("a: 1\nb:\n  - c:  2\n", "f")

    assert SourcePlace(2, 1) == document.keys["b",]
    assert SourcePlace(3, 3) == document.values["b",]
    assert SourcePlace(3, 5) == document.keys["b", 0, "c"]
    assert SourcePlace(3, 9) == document.values["b", 0, "c"]


def test_byte_order_mark_and_line_ends(tmp_path: Path) -> None:
    """A byte order mark and Windows line ends change neither data nor places."""
    path = tmp_path / "f.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    document = load_yaml(path)

    assert document.data == {"a": 1, "b": 2}
    assert (SourcePlace(1, 4), SourcePlace(2, 4)) == (document.values["a",], document.values["b",])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3", "f.yaml:3:1: duplicate key 'a', first in line 1"),
        ("a: {b: 1, b: 2}", "f.yaml:1:11: duplicate key 'b', first in line 1"),
        ("a: 1\n'a': 2", "f.yaml:2:1: duplicate key 'a', first in line 1"),
        ("a: &one 1", "f.yaml:1:4: anchor &one is not allowed"),
        ("&k a: 1", "f.yaml:1:1: anchor &k is not allowed"),
        ("a: !!float 1", "f.yaml:1:4: tag !!float is not allowed, the type follows from the value"),
        ("a: !x {}", "f.yaml:1:4: tag !x is not allowed, the type follows from the value"),
        ("<<: {a: 1}", "f.yaml:1:1: merge key << is not allowed, write the keys out"),
        ("1: 2", "f.yaml:1:1: a key must be a text (got 1), put it in quotes"),
        ("true: 2", "f.yaml:1:1: a key must be a text (got true), put it in quotes"),
        ("[a]: 2", "f.yaml:1:1: a key must be a text"),
        ("a: 1\n---\nb: 2", "f.yaml:2:1: a second document starts, allowed: one in a file"),
        ("", "f.yaml:1:1: the file is empty"),
        ("# nothing\n", "f.yaml:1:1: the file is empty"),
        ("---\n", "f.yaml:2:1: the top level must be a mapping, lines of `key: value`"),
        ("- 1", "f.yaml:1:1: the top level must be a mapping, lines of `key: value`"),
        ("a: 99999999999999999999", "f.yaml:1:4: whole number beyond 64 bits"),
        ('a: "\\ud800"', "f.yaml:1:4: half of a surrogate pair is not a character"),
        ("a: 1\nb: \x07", "f.yaml:2:4: character '\\x07' is not allowed in YAML"),
        (
            "a: 1\nb: 2\n c: 3",
            "f.yaml:3:3: mapping values are not allowed here, check the indentation, quote a text",
        ),
        (
            "a:\n\tb: 1",
            "f.yaml:2:1: while scanning for the next token, found character '\\t' that cannot",
        ),
        (
            "a: 1\nb\nc: 2",
            "f.yaml:3:1: while scanning a simple key, could not find expected ':', a key needs '",
        ),
        (
            "a: {b: 1",
            "f.yaml:1:9: while parsing a flow mapping, expected ',' or '}', but got '<stream",
        ),
        (
            'a: 1\nb: "\\UFFFFFFFF"',
            "f.yaml:2:1: an escape or directive near here has a number that is too large",
        ),
    ],
)
def test_refusals(text: str, expected: str) -> None:
    """Each refusal states file, line and column."""
    (problem,) = problems_in(text)

    assert problem.startswith(expected)


def test_alias_is_refused_with_its_anchor() -> None:
    """An anchor and its alias are two problems."""
    assert problems_in("a: &x 1\nb: *x") == [
        "f.yaml:1:4: anchor &x is not allowed",
        "f.yaml:2:4: alias *x is not allowed, write the value out",
    ]


def test_merge_key_in_quotes_is_a_text() -> None:
    """Only the bare << is the merge key of YAML 1.1."""
    assert parse_yaml("'<<': 1", "f").data == {"<<": 1}


def test_all_problems_at_once() -> None:
    """Problems before invalid YAML are reported with it."""
    assert problems_in("a: 1\na: 2\nb: {c") == [
        "f.yaml:2:1: duplicate key 'a', first in line 1",
        "f.yaml:3:6: while parsing a flow mapping, expected ',' or '}', but got '<stream end>'",
    ]


def test_flood_of_problems_is_cut() -> None:
    """After fifty problems only the number of the others is reported."""
    lines = problems_in("\n".join(["a: 1"] * 61))

    assert len(lines) == 51
    assert lines[-1] == "f.yaml: 10 more problems are not shown"


@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ("{a: ", "}")])
def test_depth_is_bounded(opening: str, closing: str) -> None:
    """The deepest allowed nesting is read; one more level is refused."""
    levels = MAX_DEPTH - 1
    parse_yaml("a: " + opening * levels + closing * levels, "f.yaml")

    (problem,) = problems_in("a: " + opening * (levels + 1) + closing * (levels + 1))
    assert problem.endswith(f"nested too deeply, allowed: {MAX_DEPTH} levels")


def test_depth_bomb_is_refused_at_once() -> None:
    """A file of brackets only does not exhaust the stack."""
    (problem,) = problems_in("[" * 200_000)

    assert f"f.yaml:1:{MAX_DEPTH + 1}: nested too deeply, allowed: {MAX_DEPTH} levels" == problem


def test_size_is_bounded(tmp_path: Path) -> None:
    """A file of the largest size is read; one more byte is refused."""
    path = tmp_path / "f.yaml"
    path.write_bytes(b"a: 1\n" + b"#" * (MAX_BYTES - 5))
    assert load_yaml(path).data == {"a": 1}

    path.write_bytes(b"a: 1\n" + b"#" * (MAX_BYTES - 4))
    with pytest.raises(ConfigError, match=f"too large, allowed: at most {MAX_BYTES} bytes"):
        load_yaml(path)


def test_file_that_is_not_utf8(tmp_path: Path) -> None:
    """The message states the first byte that is not UTF-8, with its place."""
    path = tmp_path / "f.yaml"
    path.write_bytes("a: 1\nb: ä µ".encode("latin-1"))

    with pytest.raises(ConfigError) as caught:
        load_yaml(path)
    expected = f"{path}:2:4: not UTF-8 (got byte 0xe4), save the file as UTF-8"
    assert expected == str(caught.value)


@pytest.mark.parametrize(
    ("name", "what"),
    [("missing.yaml", "cannot be read"), ("a\0b", "cannot be read"), (".", "this is a folder")],
)
def test_file_that_cannot_be_read(tmp_path: Path, name: str, what: str) -> None:
    """A missing file, a folder and an impossible name are configuration errors."""
    with pytest.raises(ConfigError, match=what):
        load_yaml(tmp_path / name)


@pytest.mark.parametrize(
    ("path", "text"),
    [((), ""), (("a", 0, "b"), "a[0].b"), (("a b",), "a b"), (("", "\n"), "''.'\\n'")],
)
def test_paths_are_written_as_a_person_would(path: tuple[str | int, ...], text: str) -> None:
    """Indices are in brackets; unprintable names are quoted."""
    assert text == format_path(path)


YAML_PIECES = st.sampled_from(
    ["a", "b: ", ": ", "\n", "  ", "- ", "[", "]", "{", "}", ", ", "&x ", "*x", "!t ", "<<", "'",
     '"', "|", ">", "#", "%YAML 1.", "%TAG ! ", "---\n", "...\n", "? ", "\t", "\\U", "FFFFFFFF",
     "1e3", "~", "\x00", "\ufeff", "\x85", "\ud800", "9" * 30, "@", "`"]
)  # fmt: skip


@given(st.one_of(st.text(), st.lists(YAML_PIECES, max_size=30).map("".join)))
@example('"\\UFFFFFFFF"')
@example("%YAML " + "9" * 5000 + ".1\n--- {}")
@example("%YAML 1.1\n%YAML 1.1\n---\n")
def test_no_text_raises_anything_else(text: str) -> None:
    """Any text gives a mapping or a ConfigError with a place."""
    try:
        document = parse_yaml(text, "f.yaml")
    except ConfigError as error:
        assert all(problem.line >= 1 for problem in error.problems)
    else:
        assert isinstance(document.data, dict)


@given(st.binary(max_size=200))
def test_no_bytes_raise_anything_else(tmp_path_factory: pytest.TempPathFactory, raw: bytes) -> None:
    """Any bytes give a mapping or a ConfigError."""
    path = tmp_path_factory.getbasetemp() / "bytes.yaml"
    path.write_bytes(raw)
    try:
        assert isinstance(load_yaml(path).data, dict)
    except ConfigError as error:
        assert str(path) in str(error)


TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=10)
NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
DATA = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXTS,
    lambda inner: (
        st.lists(inner, max_size=4).map(tuple) | st.dictionaries(TEXTS, inner, max_size=4)
    ),
    max_leaves=20,
)


@given(st.dictionaries(st.text("abc", min_size=1), DATA, max_size=4))
def test_data_written_by_another_program_round_trips(data: dict[str, object]) -> None:
    """Data written by PyYAML with all texts in quotes is read back unchanged."""
    text = yaml.dump(data, Dumper=QuotingDumper, allow_unicode=True)

    assert data == parse_yaml(text, "f").data


class QuotingDumper(yaml.SafeDumper):
    """Writes tuples as lists and texts in quotes, because bare words differ in YAML 1.1 and 1.2."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - fixed by the base class
        """Write every value in full."""
        return True


QuotingDumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)
QuotingDumper.add_representer(
    tuple, lambda dumper, items: dumper.represent_sequence("tag:yaml.org,2002:seq", list(items))
)
