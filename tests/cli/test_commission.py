"""`piezod probe` and `piezod commission`, on a clock that needs no waiting."""

import json
import os
import pty
import re
import signal
import threading
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
import yaml

from piezod.cli.interrupt import Interrupted, interruptible, unwinding
from piezod.commission import bench
from piezod.devices import registry
from piezod.devices.interface import ChannelUnits
from piezod.errors import DeviceError
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from tests.cli.conftest import Command

SHIPPED = Path(__file__).parents[2] / "config" / "simulated.yaml"


@pytest.fixture(autouse=True)
def _nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "MonotonicClock", lambda: FakeClock(1_000_000_000))


@pytest.fixture
def config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a configuration in its own folder, with the lock files of its devices there too."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    path = folder / "stage.yaml"
    model = SHIPPED.parent / "models" / "simulated-stack.yaml"
    text = SHIPPED.read_text(encoding="utf-8").replace("models/simulated-stack.yaml", str(model))
    text = text.replace("rate_hz: 200", "rate_hz: 1000")  # the first mode is at 734 Hz
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have sheets without figures: to draw them takes longer than the rest."""
    monkeypatch.setattr("piezod.commission.sheet.draw", lambda _: iter(()))


def test_probe_reports_identities_and_moves_nothing(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report has identity, readings and allowed rate; no voltage is written."""
    written: list[object] = []
    monkeypatch.setattr(SimulatedRig, "write", lambda _rig, *values: written.append(values))
    outcome = piezod("probe", str(config))

    assert outcome.code == 0, outcome.err
    assert "piezod, simulated stack, seed 1" in outcome.out
    assert "Hz in the cycle" in outcome.out
    assert written == []


def test_probe_wiggles_after_a_yes(piezod: Command, config: Path) -> None:
    """The document has the motion per volt."""
    outcome = piezod("probe", str(config), "--wiggle", "--yes", "--json")
    document = json.loads(outcome.out)

    assert 0.05 < document["wiggled"]["x"]["um_per_v"] < 0.2
    assert document["devices"]["rig"]["capabilities"]["read_back"] is True


def test_probe_says_which_device_is_absent(piezod: Command, config: Path) -> None:
    """An absent device is named, and the exit code is 69."""
    text = config.read_text(encoding="utf-8")
    absent = "rig: {driver: emulated, options: {socket: nowhere.sock}}"
    config.write_text(text.replace("rig: {driver: simulated, options: {variant: stack}}", absent))
    outcome = piezod("probe", str(config))

    assert outcome.code == 69
    assert "device rig:" in outcome.err


@pytest.fixture
def talking_port(config: Path) -> Iterator[Path]:
    """Yield the configuration of a sensor at a pty, which answers `P?` by `hello`."""
    far_end, slave = pty.openpty()
    tty.setraw(slave)

    def answer() -> None:
        with suppress(OSError):  # the end of the test closes the pty
            while os.read(far_end, 100):
                os.write(far_end, b"hello\r\n")

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    options = {
        "port": os.ttyname(slave),
        "inputs": {"x": {}},
        "read": [{"send": "P?", "reply": r"(?P<x>[\d.]+)"}],
        "timeout_ms": 1000,
    }
    document = yaml.safe_load(config.read_text(encoding="utf-8"))
    document["devices"]["gauge"] = {"driver": "ascii", "options": options}
    document["axes"]["x"]["sensor"] = {"device": "gauge", "channel": "x"}
    config.write_text(yaml.safe_dump(document), encoding="utf-8")
    yield config
    os.close(slave)
    os.close(far_end)
    thread.join(10.0)


def test_probe_shows_the_bytes_on_the_line(piezod: Command, talking_port: Path) -> None:
    """With --trace each message is on stderr; a reply that does not fit is in the error as well."""
    outcome = piezod("probe", str(talking_port), "--trace")

    assert outcome.code == 69
    assert r"sent 'P?\n' (50 3F 0A)" in outcome.err
    assert r"got  'hello\r\n' (68 65 6C 6C 6F 0D 0A)" in outcome.err
    assert "'hello" in next(line for line in outcome.out.splitlines() if "ERROR" in line)
    assert " sent " not in outcome.out


def test_commission_leaves_a_sheet_and_a_configuration_that_runs(
    piezod: Command, config: Path, folder: Path
) -> None:
    """All steps are done, and the new configuration passes `piezod check`."""
    outcome = piezod("commission", str(config), "--yes", "--json")
    document = json.loads(outcome.out)

    assert outcome.code == 0, outcome.err
    assert document["not_done"] == []
    assert re.search(r"first mode at 80[678] Hz", outcome.err)
    assert (folder / "stage-x-commissioned" / "acceptance.html").exists()
    assert piezod("check", "stage-x-commissioned/stage.yaml").code == 0


def test_commission_ends_with_a_no(
    piezod: Command, config: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sheet has the results up to the no, and nothing has moved."""
    monkeypatch.setattr("sys.stdin", StringIO("y\nn\n"))
    outcome = piezod("commission", str(config))

    assert outcome.code == 0, outcome.err
    sheet = (folder / "stage-x-commissioned" / "acceptance.html").read_text(encoding="utf-8")
    assert "Not done: polarity, travel 10 %" in sheet
    assert not (folder / "stage-x-commissioned" / "stage.yaml").exists()


def test_commission_of_an_axis_that_is_not_there(piezod: Command, config: Path) -> None:
    """An unknown axis exits with 2, and the error names the known axes."""
    outcome = piezod("commission", str(config), "--axis", "z")

    assert outcome.code == 2
    assert "known: x" in outcome.err


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.few(1)
def test_commission_ramps_back_after_a_signal(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """A signal, even a repeated one, ramps the axis back and exits with 130."""
    written: list[float] = []
    write = SimulatedRig.write

    def noting(rig: SimulatedRig, drive_v: Sequence[float], now_ns: int) -> bool:
        written.append(drive_v[0])
        if drive_v[0] > 30.0:
            os.kill(os.getpid(), number)
        return write(rig, drive_v, now_ns)

    monkeypatch.setattr(SimulatedRig, "write", noting)
    outcome = piezod("commission", str(config), "--yes")

    assert outcome.code == 130
    assert max(written) < 31.0
    assert written[-1] == pytest.approx(0.0, abs=0.01)


def test_commission_stores_its_results_after_a_signal(
    piezod: Command, config: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After Ctrl-C the sheet lists the steps that were not done."""
    _write_with(monkeypatch, lambda _v: os.kill(os.getpid(), signal.SIGINT), above_v=30.0)
    outcome = piezod("commission", str(config), "--yes")
    sheet = (folder / "stage-x-commissioned" / "acceptance.html").read_text(encoding="utf-8")

    assert outcome.code == 130
    assert "Not done: travel 25 %, travel 50 %" in sheet
    assert (folder / "stage-x-commissioned" / "stage.yaml").exists()


def test_commission_interrupted_before_it_has_found_anything_leaves_no_sheet(
    piezod: Command, config: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without any result no folder is left."""
    monkeypatch.setattr("typer.confirm", lambda *_, **__: os.kill(os.getpid(), signal.SIGINT))

    assert piezod("commission", str(config)).code == 130
    assert not (folder / "stage-x-commissioned").exists()


TWO = (signal.SIGINT, signal.SIGTERM)


def _at_once(_drive_v: float) -> None:
    """Deliver two signals before Python handles the first of them."""
    signal.pthread_sigmask(signal.SIG_BLOCK, TWO)
    for number in TWO:
        signal.raise_signal(number)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, TWO)


def test_only_the_first_signal_raises() -> None:
    """Only the first signal raises; afterwards the earlier handlers are back."""
    before = [signal.getsignal(number) for number in TWO]
    heard = 0
    with interruptible(), unwinding():
        try:
            _at_once(0.0)
        except Interrupted:
            heard += 1
            _at_once(0.0)

    assert heard == 1
    assert [signal.getsignal(number) for number in TWO] == before


@pytest.mark.usefixtures("no_figures")
def test_commission_ramps_back_after_two_signals_at_once(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second signal does not interrupt the ramp back."""
    written = _write_with(monkeypatch, _at_once, above_v=30.0)
    before = [signal.getsignal(number) for number in TWO]
    outcome = piezod("commission", str(config), "--yes")

    assert outcome.code == 130, outcome.err
    assert "ignored" not in outcome.err
    assert written[-1] == pytest.approx(0.0, abs=0.01)
    assert [signal.getsignal(number) for number in TWO] == before


@pytest.mark.usefixtures("no_figures")
def test_commission_ramps_back_after_a_signal_before_it_ignores_them(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal just before signals are ignored ends with 130, with the axis ramped back."""
    undisturbed, signals = bench._signals_ignored, iter([signal.SIGINT])  # noqa: SLF001 - to come before it

    def late() -> AbstractContextManager[None]:
        for number in signals:
            os.kill(os.getpid(), number)
        return undisturbed()

    monkeypatch.setattr(bench, "_signals_ignored", late)
    written = _write_with(monkeypatch, _failing_once(), above_v=30.0)
    outcome = piezod("commission", str(config), "--yes")

    assert outcome.code == 130
    assert written[-1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("error", [DeviceError("it broke"), RuntimeError("it broke")])
def test_commission_reports_its_first_error_if_the_ramp_back_fails_too(
    piezod: Command,
    config: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    """The error names both failures of a driver; the sheet has the earlier results."""
    broken = []

    def failing(_drive_v: float) -> None:
        broken.append(True)
        raise DeviceError("the step failed") if len(broken) == 1 else error

    _write_with(monkeypatch, failing, above_v=30.0, broken=broken)
    outcome = piezod("commission", str(config), "--yes")
    sheet = (folder / "stage-x-commissioned" / "acceptance.html").read_text(encoding="utf-8")

    assert outcome.code == 1
    assert re.search(
        r"the step failed; the axis has NOT returned to 0\.00 V, the last written voltage is "
        r"(29|30)\.\d+ V: it broke",
        outcome.err,
    )
    assert "Not done: travel 25 %" in sheet


def test_commission_reports_its_first_error_if_no_sheet_can_be_written(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error of the axis is printed last, after that of the sheet."""

    def full(*_: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr("piezod.cli.devices.commission_run.write_sheet", full)
    _write_with(monkeypatch, _failing_once(), above_v=30.0)
    outcome = piezod("commission", str(config), "--yes")

    assert outcome.code == 1
    assert outcome.err.endswith("no sheet was written: no space\nthe step failed\n")


def _failing_once() -> Callable[[float], None]:
    errors = iter([DeviceError("the step failed")])

    def failing(_drive_v: float) -> None:
        for error in errors:
            raise error

    return failing


def _write_with(
    monkeypatch: pytest.MonkeyPatch,
    then: Callable[[float], object],
    *,
    above_v: float,
    broken: Sequence[object] = (),
) -> list[float]:
    """Call `then` before each write above a voltage, or while broken; return the voltages."""
    written: list[float] = []
    write = SimulatedRig.write

    def noting(rig: SimulatedRig, drive_v: Sequence[float], now_ns: int) -> bool:
        if drive_v[0] > above_v or broken:
            then(drive_v[0])
        written.append(drive_v[0])
        return write(rig, drive_v, now_ns)

    monkeypatch.setattr(SimulatedRig, "write", noting)
    return written


@pytest.mark.parametrize(
    ("answers", "found"),
    [("y\ny\n", ["noise", "polarity"]), ("y\nn\n", ["noise"]), ("n\n", [])],
)
@pytest.mark.few(1)
def test_probe_wiggles_in_the_first_steps_of_commission(
    piezod: Command,
    config: Path,
    monkeypatch: pytest.MonkeyPatch,
    answers: str,
    found: list[str],
) -> None:
    """Each step is announced and confirmed; results go to stdout."""
    monkeypatch.setattr("sys.stdin", StringIO(answers))
    written = _write_with(monkeypatch, lambda _drive_v: None, above_v=0.0)
    outcome = piezod("probe", str(config), "--wiggle")

    assert outcome.code == 0, outcome.err
    assert "axis x: noise: hold 0.00 V for 2 s and record the sensor? [Y/n]" in outcome.err
    assert re.findall(r"^ ?axis x: (\w+): ", outcome.out, re.MULTILINE) == found
    assert (max(written, default=0.0) > 2.9) == ("polarity" in found)


def test_probe_reports_units_and_the_rate_of_all_devices_together(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Units are those of the driver; a common rate is printed only for several devices."""
    document = yaml.safe_load(config.read_text(encoding="utf-8"))
    document["devices"] |= {"other": document["devices"]["rig"]}
    document["axes"] |= {"y": document["axes"]["x"] | {"amplifier": "other", "sensor": "other"}}
    alone = piezod("probe", str(config)).out
    config.write_text(json.dumps(document), encoding="utf-8")  # YAML too, and without aliases
    plugin = registry.load("simulated")
    units = dict.fromkeys("xy", "µm"), dict.fromkeys("xy", "V")
    known = replace(plugin, channels=lambda _options: ChannelUnits(*units))
    monkeypatch.setattr(registry, "load", lambda _name: known)
    text = piezod("probe", str(config)).out
    found = json.loads(piezod("probe", str(config), "--json").out)

    assert "all together" not in alone
    assert re.search(r"^  reads     x \S+ µm$", text, re.MULTILINE)
    assert re.search(r"^  in force  y \S+ V$", text, re.MULTILINE)
    assert re.search(r"^  read      \d+ µs median, \d+ µs p90, \d+ µs p99$", text, re.MULTILINE)
    assert re.search(r"^all together allow \d+ Hz in the cycle", text, re.MULTILINE)
    assert 0 < found["together_hz"] <= min(each["rate_hz"] for each in found["devices"].values())
    assert found["devices"]["rig"]["units"] == {"inputs": {"x": "µm"}, "outputs": {"x": "V"}}
