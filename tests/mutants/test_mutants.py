"""The list of equivalent mutants, and the modules of `make mutants`."""

import pytest

from tests.mutants.__main__ import listed
from tests.mutants.modules import MODULES
from tests.mutants.workshop import ROOT


@pytest.mark.parametrize("name", MODULES)
def test_files_of_a_module_exist(name: str) -> None:
    """Its tests, too; and each listed change has a reason."""
    module = MODULES[name]
    paths = [module.path, *module.tests, *(each.partition("::")[0] for each in module.left_out)]

    assert all((ROOT / path).is_file() for path in paths)
    assert listed(name).total() >= 0
