"""The modules whose mutants `make mutants` tests, and the tests that must notice each of them."""

from typing import Final, NamedTuple


class Module(NamedTuple):
    """A module, and its own tests."""

    path: str  #: The module, in the repository.
    tests: tuple[str, ...]  #: Its tests; no others are run.
    #: Tests that take long and notice nothing that the others do not notice.
    left_out: tuple[str, ...] = ()


MODULES: Final = {
    "guard": Module(
        "piezod/control/guard.py",
        (
            "tests/control/test_guard.py",
            "tests/control/test_guard_limits.py",
            "tests/control/test_guard_waits.py",
        ),
    ),
    "in_force": Module("piezod/control/in_force.py", ("tests/control/test_in_force.py",)),
    "states": Module(
        "piezod/control/stage/states.py",
        ("tests/control/stage/test_states.py",),
        (
            "tests/control/stage/test_states.py::"
            "test_every_combination_has_a_result_and_a_refusal_keeps_the_state",
        ),
    ),
    "register": Module(
        "piezod/control/faults/register.py",
        (
            "tests/control/faults/test_register.py",
            "tests/control/faults/test_register_details.py",
            "tests/control/faults/test_register_properties.py",
        ),
    ),
    "pacer": Module("piezod/daemon/loop/pacer.py", ("tests/daemon/loop/test_pacer.py",)),
}
