"""What an installation without extras, and a first start, do."""

import sys
from subprocess import run

import pytest

_WITHOUT = """
import sys
sys.modules["matplotlib"] = None  # as if it were not installed
sys.argv[1:] = {words!r}
from piezod.cli.main import run
run()
"""
_LOOP = """
import sys
from piezod.control.warm_up import warm_up
from piezod.jit import compilations
import piezod.daemon.loop.process
from tests.control.rig_stage import shipped_config
warm_up(shipped_config())
print(compilations(), "scipy" in sys.modules)
"""


def output_of(code: str) -> tuple[int, str, str]:
    """Run Python code in a process of its own; return its exit code and its output."""
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("words", [["plot", __file__], ["commission", __file__, "--yes"]])
def test_without_figures_a_command_that_draws_names_the_extra(words: list[str]) -> None:
    """In one line, before anything is driven; all others work."""
    code, out, err = output_of(_WITHOUT.format(words=words))

    assert (code, out) == (1, "")
    assert "piezod[figures]" in err
    assert err.count("\n") == 1
    assert output_of(_WITHOUT.format(words=["drivers"]))[0] == 0


def test_loop_does_not_load_scipy_once_the_kernels_are_compiled() -> None:
    """`piezod compile` compiles all that the loop needs, and a compiled kernel needs no scipy."""
    compiled = run([sys.executable, "-m", "piezod", "compile"], capture_output=True, check=False)

    assert compiled.returncode == 0
    assert output_of(_LOOP)[:2] == (0, "0 False\n")
