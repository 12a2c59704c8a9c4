"""Tests of the waveform in a recording: found by its movement, checked, and judged."""

from collections.abc import Callable

import numpy as np
import pytest

from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.config.waveforms.waveform import Waveform
from piezod.errors import DataError
from piezod.experiment.live.record import LiveRun, cut_waveform, missing_cycles
from piezod.experiment.live.setup import LiveAxis, read_setup
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry
from tests.experiment.live_fakes import FakeStage

SINE = Sine(kind="sine", low=2.0, high=12.0, frequency_hz=1.0)
CASE = CaseConfig(name="slow", title="a sine", period_s=1.0, duration_s=3.0, command_um=SINE)
RUN = LiveRun(CASE, Mode.ADAPTIVE, ("tracking_max_pct",))
START = 100
"""Cycle at whose end the movement is requested; before it the stage stays at 0.5 µm."""


@pytest.fixture
def axis() -> LiveAxis:
    """Return axis x of the stage in the repository."""
    return read_setup(FakeStage()).axes["x"]


@pytest.fixture
def waveform() -> Waveform:
    """Return a sine that does not start at the position of the stage."""
    return SINE.built(CASE.duration_s)


MakeRecording = Callable[..., RecordedTelemetry]


@pytest.fixture
def make_recording(axis: LiveAxis, waveform: Waveform) -> MakeRecording:
    """Return a function that makes a recording at 1 kHz, 0.1 µm off its command."""

    def recording(cycles: int = 3500, late_s: float = 0.0) -> RecordedTelemetry:
        motion = axis.motion(waveform, CASE.duration_s, 0.5)
        t_s = 7.0 + 0.001 * np.arange(cycles) + late_s
        moving = np.arange(cycles) > START
        since_s = t_s - t_s[START]
        command_um = np.where(moving, [motion.reference_um(t) for t in since_s.tolist()], 0.5)
        columns = {
            "motion": np.where(moving, 4, 3),
            "command_um": command_um,
            "position_um": command_um + 0.1,
            "in_force_v": 5.0 * command_um,
            "uncompensated_v": 4.0 * command_um,
        }
        snapshots = np.array([7.0, 8.0, 9.0])
        weights = {"weights": np.tile([1.0, 2.0, 3.0, 4.0], (3, 1)), "weights_t_s": snapshots}
        weights["weights_form"] = np.zeros(3, "u1")
        return RecordedTelemetry(
            TelemetryHeader("t", ("x",), 1000.0, "", 0),
            0,
            np.empty((0, 2), np.int64),
            {"t_s": t_s, "skipped": np.zeros(cycles, np.int64)},
            {"x": columns},
            {"x": weights},
        )

    return recording


def test_waveform_is_cut_after_its_lead_in(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """The result starts with the first value of the waveform, at 0 s, and has its length."""
    recording = cut_waveform(make_recording(), "x", axis, waveform, RUN)

    assert recording.key == ("x", "slow", "adaptive")
    assert recording.t_s.size == 3000
    assert 0.0 <= recording.t_s[0] < 0.001
    expected = waveform.sample(recording.t_s)
    assert recording.command_um == pytest.approx(expected, abs=1e-5)
    assert recording.drive_v == pytest.approx(5.0 * recording.command_um)
    assert recording.first_metric_index == 1000
    assert recording.metrics["tracking_max_pct"] == pytest.approx(1.0, rel=0.01)
    assert not recording.knows_truth


def test_weights_have_the_right_operators_first(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """The order is that of virtual time; snapshots before the waveform are dropped."""
    recording = cut_waveform(make_recording(), "x", axis, waveform, RUN)

    assert recording.weights.tolist() == [[3.0, 4.0, 1.0, 2.0]] * 2
    assert recording.weights_t_s == pytest.approx([0.85, 1.85], abs=0.05)


def test_late_cycles_keep_their_times(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """The waveform is a function of the time of each cycle, with its jitter."""
    jitter_s = 3e-4 * np.random.default_rng(1).random(3500)

    recording = cut_waveform(make_recording(late_s=jitter_s), "x", axis, waveform, RUN)

    assert recording.command_um == pytest.approx(waveform.sample(recording.t_s), abs=1e-5)


def test_recording_that_ends_early_is_refused(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """Errors of a part must not be taken for those of the whole."""
    with pytest.raises(DataError, match="the recording ends before the waveform"):
        cut_waveform(make_recording(cycles=3000), "x", axis, waveform, RUN)


def test_recording_that_starts_late_is_refused(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """The begin of the movement is then unknown."""
    whole = make_recording()
    whole.axes["x"]["motion"][:] = 4

    with pytest.raises(DataError, match="does not start before the movement"):
        cut_waveform(whole, "x", axis, waveform, RUN)


def test_other_command_is_refused(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """The recorded command must be the requested one."""
    whole = make_recording()
    whole.axes["x"]["command_um"][2000:] += 0.01

    with pytest.raises(DataError, match="in 1500 of 3399 cycles the recorded command is not"):
        cut_waveform(whole, "x", axis, waveform, RUN)


def test_missing_cycles_are_counted(make_recording: MakeRecording) -> None:
    """Skipped cycles and cycles that the recorder lost count."""
    whole = make_recording()
    whole.cycles["skipped"][2000:] = 3

    assert missing_cycles(whole) == 3


def test_coefficients_of_a_surface_keep_their_order(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """A surface has no sides to exchange."""
    telemetry = make_recording()
    telemetry.weights["x"]["weights_form"][:] = 1
    recording = cut_waveform(telemetry, "x", axis, waveform, RUN)

    assert recording.surface
    assert recording.weights.tolist() == [[1.0, 2.0, 3.0, 4.0]] * 2


def test_form_is_that_during_the_waveform(
    make_recording: MakeRecording, axis: LiveAxis, waveform: Waveform
) -> None:
    """An axis that has adopted a surface since the start of the recording has a surface."""
    telemetry = make_recording()
    telemetry.weights["x"]["weights_form"][1:] = 1  # the waveform begins after the first row

    assert cut_waveform(telemetry, "x", axis, waveform, RUN).surface
