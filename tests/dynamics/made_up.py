"""Made-up responses, and the answer of a linear system to a held voltage."""

from collections.abc import Sequence

import numpy as np

from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.measured import FloatArray, MeasuredResponse

GAIN, PHASE_RAD, CREEP = 0.15, 0.03, 0.004


def model_of(delay_s: float, *modes: tuple[float, float, float]) -> ResponseModel:
    """Return a model from frequency in Hz, damping and share of each mode."""
    return ResponseModel(delay_s, tuple(Resonance(*mode) for mode in modes))


def noisy(
    model: ResponseModel,
    noise: float,
    seed: int,
    frequency_hz: FloatArray | None = None,
    gain: float = GAIN,
) -> MeasuredResponse:
    """Return the response of small loops with noise of a share of the gain at each line."""
    f = np.geomspace(5.0, 4000.0, 120) if frequency_hz is None else frequency_hz
    rng = np.random.default_rng(seed)
    slow = gain * np.exp(-1j * PHASE_RAD) * (1j * f / f[0]) ** -CREEP
    scatter = rng.standard_normal((2, f.size)) / np.sqrt(2.0)
    response = slow * model.at(f) + noise * abs(gain) * (scatter[0] + 1j * scatter[1])
    variance = np.full(f.size, (noise * gain) ** 2)
    return MeasuredResponse(f, np.asarray(response), variance, np.ones(f.size))


def answer(model: ResponseModel, drive: FloatArray, rate_hz: float, repeats: int) -> FloatArray:
    """Return the settled answer of a model to a repeated drive, without a hold, shape (n,)."""
    spectrum = np.fft.rfft(drive)
    f = np.asarray(np.fft.rfftfreq(drive.size, 1.0 / rate_hz), dtype=np.float64)
    return np.tile(np.fft.irfft(np.asarray(spectrum * model.at(f)), drive.size), repeats)


def frequencies(model: ResponseModel) -> Sequence[float]:
    """Return the frequencies of its resonances, in Hz."""
    return [mode.frequency_hz for mode in model.resonances]
