"""How expensive the code is to read and to change, in numbers: `python -m tests.house` prints them.

A measure is a function that returns a `Measure`; add it to `MEASURES`. A test asserts that each
count is within its limit.
"""

import ast
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.messages.requests import REQUESTS

ROOT: Final = Path(__file__).parents[1]
PRODUCT: Final = ("piezod", "drivers")
EXAMPLE: Final = "follow"
"""The verb that CONTRIBUTING shows."""
WAVEFORM: Final = "chirp"
FAULT: Final = Fault.D11.value
DEVICE: Final = "adam-4024"
"""The waveform, the fault and the device that stand for all others."""
VERB_ROOMS: Final = ("piezod/messages", "piezod/client", "piezod/cli", "piezod/daemon/service")
"""In these rooms a function with the name of a verb serves the verb; elsewhere names coincide."""

SHORT_TEXT: Final = re.compile(r"""["'][A-Z]\d+["']""")
"""A text such as the name of a fault."""
BLOCK: Final = re.compile(r"( *)(async def|def|class) ")
"""The first line of a function or a class, and its indentation."""


class Measure(NamedTuple):
    """A count and its limit."""

    title: str  #: What is counted.
    found: tuple[str, ...]  #: The places that count.
    limit: int  #: How many there may be.
    in_places: int | None = None  #: The count, if a place has more than one.

    def __str__(self) -> str:
        """Return the count, and its places one per line."""
        return "\n    ".join((f"{self.number} of at most {self.limit} {self.title}", *self.found))

    @property
    def number(self) -> int:
        """How many were found."""
        return len(self.found) if self.in_places is None else self.in_places


def files_of_a_verb(name: str = EXAMPLE) -> Measure:
    """Count the product files that name a verb.

    A file names a verb if it has its request class, its name as a text, or, in the rooms on the way
    of a request, a function of its name.
    """
    files = (file for folder in PRODUCT for file in sorted((ROOT / folder).rglob("*.py")))
    found = (str(each.relative_to(ROOT)) for each in files if _names(each, name))
    return Measure(f"product files name the verb {name!r}", tuple(found), limit=3)


def files_of_a_waveform() -> Measure:
    """Count the product files that name a kind of waveform, scripts of the page included."""
    return _files_with(WAVEFORM, "waveform", limit=3)


def files_of_a_fault() -> Measure:
    """Count the product files that name a fault which the loop finds."""
    return _files_with(FAULT, "fault", limit=3)


def files_of_a_device() -> Measure:
    """Count the product files that name a device of a driver for many: profile and emulator."""
    return _files_with(DEVICE, "device", limit=2)


def _files_with(name: str, kind: str, limit: int) -> Measure:
    files = (
        file
        for folder in PRODUCT
        for ending in ("py", "js")
        for file in sorted((ROOT / folder).rglob(f"*.{ending}"))
    )
    word = re.compile(rf"\b{re.escape(name)}\b")
    found = tuple(
        str(each.relative_to(ROOT))
        for each in files
        if word.search(each.read_text(encoding="utf-8", errors="ignore"))
    )
    return Measure(f"product files name the {kind} {name!r}", found, limit)


def lines_of_product() -> Measure:
    """Count the lines of Python that are installed, by room."""
    return _lines("product", PRODUCT, limit=120_000)


def lines_of_tests() -> Measure:
    """Count the lines of the tests, by room."""
    return _lines("tests", ("tests",), limit=121_500)


def _lines(what: str, folders: Sequence[str], limit: int) -> Measure:
    rooms = Counter[str]()
    for folder in folders:
        for file in (ROOT / folder).rglob("*.py"):
            inside = file.relative_to(ROOT).parent
            rooms["/".join(inside.parts[:2])] += len(file.read_text(encoding="utf-8").splitlines())
    found = tuple(f"{room}: {lines}" for room, lines in rooms.most_common())
    return Measure(f"lines of {what}", found, limit, in_places=rooms.total())


def public_attributes_of_stage() -> Measure:
    """Count the attributes and properties of `Stage` that other files can reach."""
    tree = _tree(ROOT / "piezod/control/stage/stage.py")
    stage = next(
        node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "Stage"
    )
    found = {
        node.attr: None
        for node in ast.walk(stage)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    properties = (
        node.name
        for node in stage.body
        if isinstance(node, ast.FunctionDef) and node.decorator_list
    )
    names = (name for name in (*found, *properties) if not name.startswith("_"))
    return Measure("public attributes of Stage", tuple(names), limit=10)


def fault_ids_as_texts() -> Measure:
    """Count the places where a fault's name stands as a text, outside its enumeration."""
    names = {fault.value for fault in Fault}
    found = (
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in _product_files()
        if file != ROOT / "piezod/config/faults.py"
        and SHORT_TEXT.search(file.read_text(encoding="utf-8"))  # else walking takes seconds
        for node in ast.walk(_tree(file))
        if isinstance(node, ast.Constant) and node.value in names
    )
    return Measure("fault names as texts", tuple(found), limit=0)


def long_files() -> Measure:
    """Count the product files of more than 500 lines."""
    lengths = (
        (file, len(file.read_text(encoding="utf-8").splitlines())) for file in _product_files()
    )
    found = (f"{file.relative_to(ROOT)}: {lines}" for file, lines in lengths if lines > 500)
    return Measure("product files of more than 500 lines", tuple(found), limit=0)


def long_functions() -> Measure:
    """Count the functions of more than 60 lines."""
    found = (
        f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"
        for file in _product_files()
        if _may_have_long_functions(file)  # parsing all files takes seconds
        for node in ast.walk(_tree(file))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= 60
    )
    return Measure("functions of more than 60 lines", tuple(found), limit=0)


def words_of_docs() -> Measure:
    """Count the words of all Markdown pages, without the appendix that a command makes."""
    folders = ("docs", "drivers", "piezod")
    pages = [
        *ROOT.glob("*.md"),
        *(page for each in folders for page in (ROOT / each).rglob("*.md")),
    ]
    words = {
        str(page.relative_to(ROOT)): len(page.read_text(encoding="utf-8").split())
        for page in pages
        if page != ROOT / "docs" / "measurements.md"
    }
    found = (
        f"{page}: {words[page]}" for page in sorted(words, key=words.__getitem__, reverse=True)
    )
    title = "words of docs without the appendix"
    return Measure(title, tuple(found), limit=62_000, in_places=sum(words.values()))


MEASURES: Final[tuple[Callable[[], Measure], ...]] = (
    files_of_a_verb,
    files_of_a_waveform,
    files_of_a_fault,
    files_of_a_device,
    lines_of_product,
    lines_of_tests,
    public_attributes_of_stage,
    fault_ids_as_texts,
    long_files,
    long_functions,
    words_of_docs,
)
"""Every measure of the house."""


def _product_files() -> Iterator[Path]:
    for folder in PRODUCT:
        yield from sorted((ROOT / folder).rglob("*.py"))


@cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def _may_have_long_functions(file: Path) -> bool:
    """Return whether a function may be longer than 60 lines.

    It may if the next block that is not inside it begins later. Text at column 0 in a string can
    look like such a block, and hide a long function.
    """
    lines = file.read_text(encoding="utf-8").splitlines()
    blocks = [(at, found) for at, line in enumerate(lines) if (found := BLOCK.match(line))]
    ended = [*((len(found[1]), at) for at, found in blocks), (0, len(lines))]
    return any(
        next(later for depth, later in ended[number:] if depth <= len(found[1])) - at > 60
        for number, (at, found) in enumerate(blocks, 1)
        if found[2] != "class"
    )


def _names(file: Path, verb: str) -> bool:
    text = file.read_text(encoding="utf-8")
    request = REQUESTS[verb].__name__
    if verb not in text and request not in text:
        return False  # most files; parsing all of them takes seconds
    on_the_way = str(file.relative_to(ROOT)).startswith(VERB_ROOMS)
    names = set(_identifiers(_tree(file), with_functions=on_the_way))
    return verb in names or request in names


def _identifiers(tree: ast.AST, *, with_functions: bool) -> Iterator[str]:
    """Yield texts, names of classes and imports, and names of functions if they count."""
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)):
                yield text
            case ast.Attribute(attr=name) | ast.Name(id=name) if name[0].isupper():
                yield name
            case ast.ClassDef(name=name) | ast.alias(name=name):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) if with_functions:
                yield name


def main() -> None:
    """Print all measures."""
    for measure in MEASURES:
        print(measure())


if __name__ == "__main__":
    main()
