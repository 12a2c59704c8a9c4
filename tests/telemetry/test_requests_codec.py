import marshal
from array import array
from pathlib import Path
from typing import cast

import pytest

from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.paths import Points, Staircase
from piezod.config.waveforms.shapes import Setpoint, Sine
from piezod.config.waveforms.waveform import Waveform
from piezod.messages import requests
from piezod.telemetry.layout import REQUEST_BYTES
from piezod.telemetry.requests_codec import decode, encode, warm_up

MODEL = Path(__file__).parents[2] / "config" / "models" / "simulated-stack.yaml"
SINE = Sine(kind="sine", low=0.0, high=1.0, frequency_hz=1.0)


def wave(command_um: WaveformConfig) -> requests.Wave:
    """Return the request to follow a waveform."""
    return requests.Wave(command_um={"x": command_um}, duration_s=1.0)


EVERY_KIND = [
    requests.Arm(shadow=True),
    requests.Disarm(),
    *(requests.SelectMode(mode=mode, axis="x") for mode in Mode),
    requests.Goto(axis="x", position_um=12.5, speed_um_per_s=3.0),
    requests.Path(points=({"x": 1.0, "y": 2.5}, {"x": 2.0}), speed_per_s=3.0),
    wave(SINE).model_copy(update={"start_s": 12.5}),
    requests.Stream(axes=("x", "y")),
    requests.Follow(axis="x"),
    requests.Hold(),
    requests.Resume(),
    requests.Stop(),
    requests.Estop(),
    requests.Reset(engineer=True),
    requests.Condition(),
    requests.Zero(axis="x"),
    requests.Identify(drive_v={"x": Setpoint(kind="setpoint", level=3.0)}, duration_s=1.0),
    requests.Play(axis="x", drive_v=(1.0, 2.5), interval_s=5e-5, cycles=3, start_s=12.5),
    requests.Scan(
        axes={
            "x": requests.ScanCurve(
                lead_in_v=(0.5,), line_v=(1.0, 2.5), offset_v=(3.0,), scale=(1.0,), blend=(0.0, 1.0)
            )
        },
        interval_s=5e-5,
        pulses=(1, 0),
        pause=2,
    ),
    requests.AdoptModel(axis="x", model=load_model(MODEL), zero_um=0.3),
    requests.Shutdown(),
]


@pytest.mark.parametrize("request_", EVERY_KIND, ids=lambda request: request.kind)
def test_request_is_restored(request_: requests.Request) -> None:
    """A decoded request equals the encoded one, for every kind; a waveform is built by then."""
    restored = decode(encode(request_))
    if isinstance(restored, requests.Scan):  # its curves are arrays, of single precision
        curves = {
            axis: requests.ScanCurve(**{key: tuple(map(float, each)) for key, each in curve})
            for axis, curve in restored.axes.items()
        }
        restored = restored.model_copy(update={"axes": curves})
    built = {
        name: {axis: same(given, value[axis]) for axis, given in getattr(request_, name).items()}
        for name, value in restored
        if name in {"command_um", "drive_v"} and isinstance(value, dict)
    }

    assert restored.model_copy(update=built) == request_


def same(config: WaveformConfig, built: Waveform) -> WaveformConfig:
    """Return a waveform, if what was built has its values and bounds."""
    times_s = [0.01 * count for count in range(100)]
    own = config.built(1.0)

    assert isinstance(built, Waveform)
    assert built.sample(times_s) == own.sample(times_s)
    assert (built.low, built.high, built.highest_hz) == (own.low, own.high, own.highest_hz)
    return config


@pytest.mark.parametrize(
    "path",
    [
        Points(kind="points", points=((0.0, 1.0), (0.5, 2.0))),
        Staircase(kind="staircase", levels=(1.0, 2.0), dwell_s=0.1),
    ],
)
def test_long_path_is_packed(path: WaveformConfig) -> None:
    """The points of a path are on their way as doubles, beside each other."""
    assert array("d", (1.0, 2.0)).tobytes() in encode(wave(path))


def test_every_kind_is_tested() -> None:
    """A new kind of request must be added above."""
    tried = {type(request) for request in EVERY_KIND}
    known = {each for each in vars(requests).values() if hasattr(each, "model_fields")}

    assert {each for each in known if "kind" in each.model_fields} == tried


def test_longest_path_fits() -> None:
    """A path with the largest number of points fits into the mailbox."""
    points = tuple((0.001 * i, 1e-9 + i / 7) for i in range(10_000))
    request = wave(Points(kind="points", points=points))

    payload = encode(request)
    restored = decode(payload)
    assert isinstance(restored, requests.Wave)

    assert len(payload) <= REQUEST_BYTES
    same(request.command_um["x"], cast("Waveform", restored.command_um["x"]))


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x00", b"junk", encode(requests.Stop())[:-1], marshal.dumps([1]), marshal.dumps({})],
)
def test_invalid_payload_raises_value_error(payload: bytes) -> None:
    """The loop refuses such a request and continues."""
    with pytest.raises(ValueError, match=r"."):
        decode(payload)


def test_warm_up_has_no_side_effect() -> None:
    """It may be called at any time."""
    warm_up()
