"""Fixtures and settings for the tests of every room."""

import base64
import gc
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from fcntl import LOCK_EX, LOCK_SH, flock
from math import ceil
from pathlib import Path
from random import Random
from typing import Protocol

import pytest
from hypothesis import settings

from tests.fault_promises import PROMISES, PROVED, REACTION

HERE = Path(__file__)
KERNELS = HERE.with_name("kernels.py")
COMPILING = pytest.StashKey[subprocess.Popen[bytes]]()

# No deadline: the first example may compile a kernel. In CI every run draws the same examples.
# `make stress` asks for "long".
settings.register_profile("local", deadline=None, max_examples=20)
settings.register_profile("ci", settings.get_profile("local"), derandomize=True)
settings.register_profile("long", deadline=None, max_examples=1000)
settings.load_profile(
    os.environ.get("PIEZOD_EXAMPLES") or ("ci" if "CI" in os.environ else "local")
)

BLANK_PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAHLCMmQAAAABJRU5ErkJggg=="
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """Compile the kernels in a process of its own, while the workers start and collect.

    That process holds the lock of its source until it ends.
    """
    with KERNELS.open() as source:
        flock(source, LOCK_EX)
        command = [sys.executable, "-m", "tests.kernels"]
        config.stash[COMPILING] = subprocess.Popen(
            command, cwd=HERE.parents[1], pass_fds=[source.fileno()]
        )


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if the kernels could not be compiled."""
    compiling = session.config.stash.get(COMPILING, None)
    if compiling is not None and compiling.wait():
        pytest.exit("`python -m tests.kernels` failed", pytest.ExitCode.TESTS_FAILED)


def pytest_configure(config: pytest.Config) -> None:
    """Make a worker of xdist share work with the others."""
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(SharingWorker())


class SharingWorker:
    """Avoids work that another process of the same test run does."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """Collect without garbage collection: whatever is collected stays until the end."""
        gc.disable()
        result = yield
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)  # records of cycles are kept, and each makes it look
        gc.enable()
        return result

    def pytest_runtestloop(self) -> None:
        """Wait for the kernels before the first test."""
        with KERNELS.open() as source:
            flock(source, LOCK_SH)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder with reference vectors and recorded data, which no checkout contains.

    It is `PIEZOD_SHARED_DATA` where that is set, else the folder `shared` beside the checkout.
    """
    beside = Path(__file__).parents[2] / "shared"
    folder = Path(os.environ.get("PIEZOD_SHARED_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no test data: {folder} is not a folder (set PIEZOD_SHARED_DATA)")
    return folder


def leave_figures_blank(patch: pytest.MonkeyPatch) -> None:
    """Have reports with blank figures: to make and draw them takes longer than the rest."""
    module = "piezod.records.report_figures"
    for kind in ("case", "identification", "mode", "overview", "published", "remaining"):
        patch.setattr(f"{module}.{kind}_figure", lambda *_: None)
    patch.setattr(f"{module}.png_bytes", lambda _: BLANK_PNG)


@pytest.fixture
def blank_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have reports with blank figures."""
    leave_figures_blank(monkeypatch)


@pytest.fixture(autouse=True, scope="session")
def plain_figures() -> Iterator[tuple[str, int]]:
    """Draw few pixels without a constrained layout: a third of the time.

    Yield the layout and the dots per inch that users get; see `layout`.
    """
    # The process that starts the workers draws no figure.
    from piezod.records.figures import style  # noqa: PLC0415 - see above

    settings = vars(style)["_SETTINGS"]
    of_users = vars(style)["_LAYOUT"], settings["savefig.dpi"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "_LAYOUT", "none")
        patch.setitem(settings, "savefig.dpi", 20)
        yield of_users


@pytest.fixture
def layout(monkeypatch: pytest.MonkeyPatch, plain_figures: tuple[str, int]) -> None:
    """Draw figures as users see them."""
    from piezod.records.figures import style  # noqa: PLC0415 - as above

    arrangement, dots_per_inch = plain_figures
    monkeypatch.setattr(style, "_LAYOUT", arrangement)
    monkeypatch.setitem(vars(style)["_SETTINGS"], "savefig.dpi", dots_per_inch)


@pytest.fixture(autouse=True, scope="session")
def looks_here() -> Iterator[Callable[[], bool]]:
    """Look through HDF5 files in this process, without the start of another one for each.

    Yield what users have; see `looks_elsewhere`.
    """
    from piezod import resource_limits  # noqa: PLC0415 - as above

    of_users = resource_limits.is_bounded
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resource_limits, "is_bounded", lambda: True)
        yield of_users


@pytest.fixture
def looks_elsewhere(monkeypatch: pytest.MonkeyPatch, looks_here: Callable[[], bool]) -> None:
    """Look through HDF5 files in a process of its own, as for users."""
    from piezod import resource_limits  # noqa: PLC0415 - as above

    monkeypatch.setattr(resource_limits, "is_bounded", looks_here)


Figure = Callable[[str], None]
"""Told a line of text with what a test has measured."""


@pytest.fixture
def figure(record_property: Callable[[str, object], None]) -> Figure:
    """Return what notes a measured figure: all of them are printed below the results."""

    def note(line: str) -> None:
        print(line)
        record_property("figure", line)

    return note


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave most cases of a test marked with `few` to `make stress`, the same ones always.

    Proofs of faults run in any case.
    """
    cases = defaultdict(list)
    for item in items:
        proves = item.get_closest_marker("fault") or item.get_closest_marker("sees")
        if item.get_closest_marker("few") and not proves:
            cases[item.nodeid.partition("[")[0]].append(item)
    for group in cases.values():
        (number,) = next(group[0].iter_markers("few")).args
        drawn = Random(0)  # noqa: S311 - no secret
        for item in drawn.sample(group, max(len(group) - number, 0)):
            item.add_marker("stress")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Put the faults that a test proves into its report, for `make faults`."""
    item.user_properties += [(PROVED, str(mark.args[0])) for mark in item.iter_markers("fault")]


class Reaction(Protocol):
    """Notes the time from a cause to the reaction, for `make faults`."""

    def __call__(self, fault: str, *, cycles: int | None = None, ms: float | None = None) -> None:
        """Note a reaction after its cause; cycles are of virtual time, and within the promise."""
        ...


@pytest.fixture
def reaction(record_property: Callable[[str, object], None]) -> Reaction:
    """Return what notes the measured time of a reaction, see `tests.fault_promises`."""

    def note(fault: str, *, cycles: int | None = None, ms: float | None = None) -> None:
        promise = PROMISES[fault]
        if cycles is not None:
            assert cycles > 0, f"{fault}: a reaction in cycle {cycles} has another cause"
            assert promise.cycles is not None, f"{fault} has no promise in cycles"
            assert cycles <= promise.cycles, f"{fault}: {cycles} of {promise.bound}"
            record_property(REACTION, [str(fault), int(cycles)])
        if ms is not None:
            assert ms > 0.0, f"{fault}: a reaction after {ms:g} ms has another cause"
            assert promise.ms is not None, f"{fault} has no promise in ms"
            record_property(REACTION, [str(fault), ceil(ms)])

    return note


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the figures that tests have measured, whether these passed or not."""
    reports = [r for kind in ("passed", "failed") for r in terminalreporter.getreports(kind)]
    lines = [line for r in reports for name, line in r.user_properties if name == "figure"]
    if lines:
        terminalreporter.section("figures")
    for line in sorted(map(str, lines)):
        terminalreporter.line(line)
