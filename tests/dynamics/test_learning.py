"""Learning of a periodic command, on linear stages with a known and a true response."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics.harmonics import MEASURED_SHIFT, STORED_SHIFT, Harmonics, ResponseAt
from piezod.dynamics.learning import Learner, Stop, average_of
from piezod.dynamics.model import FloatArray, Resonance, ResponseModel

N, F0_HZ = 100, 100.0
PLAY_S = 10.0
FREQUENCY_HZ: FloatArray = F0_HZ * np.arange(N // 2 + 1, dtype=np.float64)
KNOWN = ResponseModel(200e-6, (Resonance(800.0, 0.03),))
SENSOR = ResponseModel(150e-6)
TURNS = np.arange(N) / N
COMMAND = 12.0 - 10.0 * np.cos(2 * np.pi * TURNS) + 0.5 * np.sin(6 * np.pi * TURNS)


def harmonics(known: ResponseAt = KNOWN.at, shift: float = MEASURED_SHIFT) -> Harmonics:
    """Return what is known, up to 3 kHz."""
    beyond = np.where(FREQUENCY_HZ <= 3000.0, 0.0, np.inf)
    return Harmonics.known(FREQUENCY_HZ, known, SENSOR.at, beyond, shift)


class LinearStage:
    """A stage whose true response differs from the known one."""

    def __init__(
        self, response: ResponseModel, gain: float = 1.0, noise: float = 0.0, offset: float = 0.0
    ) -> None:
        self.response, self.gain, self.noise, self.offset = response, gain, noise, offset
        self.rng = np.random.default_rng(1)

    def periods(self, wanted: FloatArray) -> npt.NDArray[np.float64]:
        """Return ten periods of samples."""
        spectrum = np.fft.rfft(wanted) * self.response.at(FREQUENCY_HZ) * self.gain
        period = np.fft.irfft(spectrum, N) + self.offset
        return period + self.noise * self.rng.standard_normal((10, N))


def learned(
    stage: LinearStage, learner: Learner, change: Callable[[int], None] = lambda _: None
) -> tuple[list[float], Stop]:
    """Learn until it stops; return the rms errors of all passes, and why it stopped."""
    errors: list[float] = []
    while True:
        wanted = learner.next(PLAY_S * len(errors))
        found = learner.assess(average_of(stage.periods(wanted)))
        errors.append(found.rms)
        stop = learner.take(found)
        if stop is not None:
            return errors, stop
        change(len(errors))


def test_exact_response_needs_no_learning() -> None:
    """The first input puts the displacement on the command: the sensor shows the target."""
    learner = Learner(COMMAND, harmonics(), 5)
    errors, stop = learned(LinearStage(KNOWN), learner)

    assert errors[0] < 1e-9
    assert stop is Stop.AT_NOISE or errors[-1] < 1e-9
    true = np.fft.rfft(learner.best) * KNOWN.at(FREQUENCY_HZ) / SENSOR.at(FREQUENCY_HZ)
    assert np.fft.irfft(true, N) == pytest.approx(COMMAND, abs=1e-9)


@given(
    st.floats(0.6, 1.35),
    st.floats(-0.002, 0.002),
    st.floats(-20e-6, 20e-6),
    st.floats(-1.0, 1.0),
)
def test_error_falls_although_the_response_is_not_the_known_one(
    gain: float, shift: float, delay_s: float, offset: float
) -> None:
    """Gain, mode, delay and offset may differ: eight passes leave less than 2 % of the error."""
    true = ResponseModel(200e-6 + delay_s, (Resonance(800.0 * (1.0 + shift), 0.03),))
    stage = LinearStage(true, gain, noise=1e-6, offset=offset)
    learner = Learner(COMMAND, harmonics(), 8)
    errors, _ = learned(stage, learner)

    assert min(errors) <= max(0.02 * errors[0], 1e-6)


def test_learning_stops_at_the_noise() -> None:
    """What remains is as small as the noise of the average, and no noise is learned."""
    stage = LinearStage(KNOWN, gain=0.8, noise=0.05)
    learner = Learner(COMMAND, harmonics(), 30)
    errors, stop = learned(stage, learner)

    assert stop in {Stop.AT_NOISE, Stop.SETTLED}
    assert len(errors) < 12
    exact = np.fft.rfft(COMMAND) * SENSOR.at(FREQUENCY_HZ) / KNOWN.at(FREQUENCY_HZ) / 0.8
    assert np.std(learner.best - np.fft.irfft(exact, N)) < 0.05


def test_growth_ends_at_the_best_input() -> None:
    """A stage that changes for the worse ends learning after the error has grown twice."""
    stage = LinearStage(KNOWN, gain=0.9, noise=1e-4)
    learner = Learner(COMMAND, harmonics(), 30)

    def change(passes: int) -> None:
        if passes == 3:
            stage.gain = -1.0  # every correction now makes it worse

    errors, stop = learned(stage, learner, change)

    assert stop is Stop.GREW
    assert learner.best_pass == int(np.argmin(errors)) == 2
    assert len(errors) == 5


def test_one_growth_is_forgiven_with_half_of_the_gain() -> None:
    """After one bad record, learning goes on from the best input."""
    stage = LinearStage(KNOWN, gain=0.8, noise=1e-5)
    learner = Learner(COMMAND, harmonics(), 12)

    def change(passes: int) -> None:
        stage.offset = 5.0 if passes == 2 else 0.0

    errors, stop = learned(stage, learner, change)

    assert errors[2] > errors[1]
    assert stop is not Stop.GREW
    assert min(errors) < 0.02 * errors[0]


def test_error_that_cannot_fall_stops_learning() -> None:
    """An offset that no input changes remains; learning does not go on for ever."""

    class Saturated(LinearStage):
        def periods(self, wanted: FloatArray) -> npt.NDArray[np.float64]:
            return np.minimum(super().periods(wanted), 15.0)

    learner = Learner(COMMAND, harmonics(), 50)
    errors, stop = learned(Saturated(KNOWN, noise=1e-4), learner)

    assert stop in {Stop.SETTLED, Stop.GREW}
    assert len(errors) < 12
    assert min(errors) <= errors[0]


def test_mode_that_the_response_lacks_is_not_excited() -> None:
    """A sharp mode on a harmonic with an error of 1 % moves the stage by about a tenth."""
    true = ResponseModel(200e-6, (Resonance(500.0, 0.005),))
    errors_pct: list[float] = []

    class Distorted(LinearStage):
        def periods(self, wanted: FloatArray) -> npt.NDArray[np.float64]:
            periods = super().periods(wanted) + 0.2 * np.sin(10 * np.pi * TURNS)  # 1 % at 500 Hz
            errors_pct.append(float(np.ptp(periods[0] - learner.target) / np.ptp(COMMAND) * 50.0))
            return periods

    learner = Learner(COMMAND, harmonics(), 8)
    _, stop = learned(Distorted(true, noise=1e-4), learner)

    assert stop is Stop.GREW
    assert max(errors_pct) < 15.0


def test_large_error_of_a_harmonic_is_corrected_after_a_careful_step() -> None:
    """The first step is small; once the stage has followed it, the error falls as usual."""

    class Distorted(LinearStage):
        def periods(self, wanted: FloatArray) -> npt.NDArray[np.float64]:
            return super().periods(wanted) + 0.4 * np.sin(10 * np.pi * TURNS)  # 2 % of the swing

    errors, _ = learned(Distorted(KNOWN, noise=1e-5), Learner(COMMAND, harmonics(), 6))

    assert errors[1] == pytest.approx(errors[0], rel=0.1)
    assert errors[2] < 0.4 * errors[1]
    assert errors[-1] < 0.02 * errors[0]


def test_number_of_passes_is_kept() -> None:
    """With two passes there are three plays."""
    errors, stop = learned(LinearStage(KNOWN, 0.7, 1e-6), Learner(COMMAND, harmonics(), 2))

    assert stop is Stop.PASSES
    assert len(errors) == 3


def test_harmonics_at_a_sharp_mode_and_beyond_the_measurement_are_not_learned() -> None:
    """There the response may be wrong by more than the correction can bear."""
    sharp = ResponseModel(200e-6, (Resonance(804.0, 0.003),))
    today, later = (harmonics(sharp.at, shift) for shift in (MEASURED_SHIFT, STORED_SHIFT))

    def unlearned(known: Harmonics) -> list[float]:
        return list(map(float, FREQUENCY_HZ[~known.learned]))

    assert unlearned(harmonics(KNOWN.at)) == list(np.arange(3100.0, 5001.0, 100.0))
    assert 800.0 in unlearned(today)
    assert {700.0, 900.0}.isdisjoint(unlearned(later))
    assert later.learned[0]


def test_harmonics_that_the_stage_hardly_follows_are_not_learned() -> None:
    """Behind a mode at 400 Hz a harmonic of 2 kHz would need 24 times its amplitude."""
    low = ResponseModel(200e-6, (Resonance(404.0, 0.03),))
    learned_hz = FREQUENCY_HZ[harmonics(low.at).learned]

    assert learned_hz.max() == 1800.0


def test_unlearned_harmonics_are_not_driven() -> None:
    """The input has nothing at a frequency that is not known, in any pass."""
    sharp = ResponseModel(200e-6, (Resonance(804.0, 0.003),))
    known = harmonics(sharp.at)
    ringing = COMMAND + 0.2 * np.cos(16 * np.pi * TURNS)  # 800 Hz
    learner = Learner(ringing, known, 4)
    learned(LinearStage(KNOWN, 0.8, 1e-3), learner)

    for wanted in (learner.best, learner.next(0.0)):
        assert np.abs(np.fft.rfft(wanted)[~known.learned]).max() < 1e-9


@pytest.mark.parametrize("shift", [0.0, MEASURED_SHIFT, -MEASURED_SHIFT])
@pytest.mark.parametrize("damping", [0.005, 0.01, 0.03, 0.3])
def test_every_learned_harmonic_converges_if_the_mode_is_shifted(
    damping: float, shift: float
) -> None:
    """The factor per pass is below 0.8 for a mode that is where it may be."""
    for mode_hz in np.arange(700.0, 900.0, 7.0):
        assumed = ResponseModel(200e-6, (Resonance(mode_hz, damping),))
        known = harmonics(assumed.at)
        true = ResponseModel(200e-6, (Resonance(mode_hz * (1.0 + shift), damping),))
        ratio = true.at(FREQUENCY_HZ) / known.response
        factor = np.abs(1.0 - 0.7 * ratio)[known.learned]

        assert factor.max() < 0.8


def test_drift_from_period_to_period_is_not_noise() -> None:
    """A slow drift of all periods leaves the noise as it is."""
    noise = 0.1 * np.random.default_rng(2).standard_normal((50, N))
    still, drifting = average_of(noise), average_of(noise + np.linspace(0, 0.2, 50)[:, None])

    assert drifting.noise[0] < 1.2 * still.noise[0]
    assert drifting.noise[1:] == pytest.approx(still.noise[1:])
    # 50 periods: the noise of the average is a seventh of that of a sample.
    rms = np.sqrt(2 * np.sum(still.noise[1:] ** 2)) / N
    assert rms == pytest.approx(0.1 / np.sqrt(50), rel=0.1)
