"""Tests of `make mutants`, without mutmut."""

from collections import Counter

import pytest

from tests.mutants.__main__ import complaints, listed
from tests.mutants.modules import MODULES
from tests.mutants.workshop import ROOT, Change, Findings, change_of, with_functions

CHANGE = Change("Guard.admit", "a < b", "a <= b")
OTHER = Change("Guard.admit", "a + b", "a - b")
SHOWN = """# piezod.control.guard.xǁLimitsǁget_window__mutmut_3: survived
--- piezod/control/guard.py
+++ piezod/control/guard.py
@@ -1,3 +1,3 @@
 def get_window(self) -> Window:
-    return Window(low_v,
-        high_v)
+    return Window(low_v, None)
"""


def test_properties_become_functions() -> None:
    """Anything else stays as it is, also another decorator."""
    source = (
        "class A:\n    @property\n    def b(self) -> int:\n        return 1\n\n"
        "    @cache\n    def c(self) -> int:\n        return 2\n"
    )

    assert with_functions(source) == (
        "class A:\n    def get_b(self) -> int:\n        return 1\n    b = property(get_b)\n\n"
        "    @cache\n    def c(self) -> int:\n        return 2\n"
    )


def test_change_is_named_by_its_function_and_lines() -> None:
    """The number that mutmut gave it moves with every other change of the function."""
    change = change_of("piezod.control.guard.xǁLimitsǁget_window__mutmut_3", SHOWN)

    assert change == (
        "Limits.window",
        "return Window(low_v,\nhigh_v)",
        "return Window(low_v, None)",
    )


@pytest.mark.parametrize(
    ("survivors", "equivalent", "complaint"),
    [
        ([], [], []),
        ([CHANGE], [CHANGE], []),
        ([CHANGE], [], [f"no test notices the change {CHANGE}"]),
        ([CHANGE, CHANGE], [CHANGE], [f"no test notices the change {CHANGE}"]),
        ([OTHER], [CHANGE, OTHER], ["equivalent.yaml has a change that"]),
    ],
)
def test_survivors_and_list_must_agree(
    survivors: list[Change], equivalent: list[Change], complaint: list[str]
) -> None:
    """A survivor that is not listed is an error, and so is a listed one that is gone."""
    found = complaints(Findings(3, survivors), Counter(equivalent))

    assert len(found) == len(complaint)
    assert all(text.startswith(start) for text, start in zip(found, complaint, strict=True))


@pytest.mark.parametrize("name", MODULES)
def test_files_of_a_module_exist(name: str) -> None:
    """Its tests, too; and each listed change has a reason."""
    module = MODULES[name]
    paths = [module.path, *module.tests, *(each.partition("::")[0] for each in module.left_out)]

    assert all((ROOT / path).is_file() for path in paths)
    assert listed(name).total() >= 0
