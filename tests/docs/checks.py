"""Checks of blocks that are not run: commands with their options, modules and names exist."""

import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from functools import cache
from typing import Any, Final

from typer.main import get_command

from piezod.cli.main import app
from tests.docs.blocks import ROOT, Block
from tests.man_page import loaded

SYSTEM: Final = frozenset(
    {
        *(
            ".",
            "cp",
            "curl",
            "echo",
            "env",
            "export",
            "grep",
            "mv",
            "openssl",
            "pip",
            "pipx",
            "printf",
            "python",
            "python3",
            "rm",
            "sleep",
            "ssh",
        ),
        *("caget", "caput"),
        *("journalctl", "setpriv", "udevadm", "usermod"),
        *("systemctl", "systemd-sysusers", "systemd-tmpfiles"),
    }
)
"""Programs that piezod does not bring."""
WITHOUT_PIEZOD: Final = frozenset({"pandas", "pyarrow"})
"""Modules that a block may import and the tests do not have."""
_END: Final = frozenset({"&&", "||", "|", ";", "&"})
_MAKE: Final = re.compile(r"^([a-z-]+):", re.MULTILINE)


def mistakes(block: Block) -> list[str]:
    """Return what a block names and does not exist."""
    find = _of_shell if block.language == "sh" else _of_python
    return [f"{block}: {what}" for what in find(block.text)]


def commands(text: str) -> Iterator[list[str]]:
    """Yield the words of each command of a shell."""
    for line in text.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars="&|;")
        lexer.whitespace_split = True
        words: list[str] = []
        for word in [*lexer, ";"]:
            if word not in _END:
                words.append(word)
            elif words:
                yield words
                words = []


def _of_shell(text: str) -> Iterator[str]:
    for words in commands(text):
        program, *arguments = words
        name = program.rpartition("/")[2] or program
        if name == "env":  # env A=1 B=2 PROGRAM …
            rest = [word for word in arguments if "=" not in word]
            name, arguments = rest[0].rpartition("/")[2], rest[1:]
        if "piezod" in arguments and name == "setpriv":
            name, arguments = "piezod", arguments[arguments.index("piezod") + 1 :]
        if name == "piezod":
            yield from _of_piezod(arguments)
        elif name == "make":
            known = _MAKE.findall((ROOT / "Makefile").read_text(encoding="utf-8"))
            yield from (f"no target {each}" for each in arguments if each not in known)
        elif name == "python" and arguments[0] == "-m" and arguments[1] != "pip":
            path = ROOT / arguments[1].replace(".", "/")
            if not (path.with_suffix(".py").exists() or (path / "__main__.py").exists()):
                yield f"no module {arguments[1]}"
        elif name not in SYSTEM:
            yield f"no program {program}"


@cache
def _program() -> Any:
    return get_command(app)


def _of_piezod(arguments: list[str]) -> Iterator[str]:
    command, context = _program(), None
    while True:
        context = type(_context())(command, info_name="piezod", parent=context)
        if not hasattr(command, "commands") or (arguments and arguments[0].startswith("-")):
            break
        name, *arguments = arguments
        if name not in command.commands:
            yield f"no command {name}"
            return
        command = loaded(command.commands[name])
    try:
        command.make_parser(context).parse_args(list(arguments))
    except Exception as error:  # noqa: BLE001 - click's and typer's, which differ by version
        yield f"{' '.join(arguments)}: {error}"


@cache
def _context() -> Any:
    return _program().make_context("piezod", [], resilient_parsing=True)


def _of_python(text: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (name for each in node.names for name in _missing(each.name, ()))
        elif isinstance(node, ast.ImportFrom):
            yield from _missing(node.module or "", [each.name for each in node.names])


def _missing(module: str, names: Any) -> Iterator[str]:
    if module.partition(".")[0] in WITHOUT_PIEZOD:
        return
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        yield str(error)
        return
    yield from (f"{module} has no {name}" for name in names if not hasattr(found, name))
