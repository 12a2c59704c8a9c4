"""The readers of files and bodies that people send, each with a good example and its refusals.

Modules are imported when a reader is made, so that a fuzzer can instrument them first.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import numpy as np

ROOT: Final = Path(__file__).parents[2]
MODEL: Final = ROOT / "config" / "models" / "simulated-stack.yaml"


class Reader(NamedTuple):
    """A reader."""

    read: Callable[[Path], object]  #: Reads a file.
    good: bytes  #: Bytes that it accepts.
    refusals: tuple[type[Exception], ...]  #: The exceptions that it documents.
    kept: int = 0  #: Bytes at the beginning that are always those of `good`.

    def survives(self, content: bytes, path: Path) -> bool:
        """Return whether these bytes are accepted; any exception but a documented one passes on."""
        path.write_bytes(self.good[: self.kept] + content[self.kept :])
        try:
            self.read(path)
        except self.refusals:
            return False
        return True


def _of(function: str) -> Any:
    module, _, name = function.partition(":")
    return getattr(import_module(module), name)


def _refusals(*names: str) -> tuple[type[Exception], ...]:
    return tuple(_of(f"piezod.errors:{name}") for name in names)


def configuration() -> Reader:
    """YAML: the configuration of a stage."""
    load, registry = (
        _of("piezod.config.daemon:load_daemon"),
        import_module("piezod.devices.registry"),
    )
    good = _shipped("simulated.yaml")
    return Reader(lambda path: load(path, registry), good, _refusals("ConfigError"))


def experiment() -> Reader:
    """YAML: an experiment."""
    load = _of("piezod.config.experiment:load_experiment")
    registry = import_module("piezod.devices.registry")
    good = _shipped("experiments/qiu.yaml")
    return Reader(lambda path: load(path, registry), good, _refusals("ConfigError"))


def model() -> Reader:
    """YAML: a model file, with stops."""
    good = _shipped("models/simulated-stack.yaml")
    return Reader(_of("piezod.control.law.model_files:read_model"), good, _refusals("ConfigError"))


def surface() -> Reader:
    """YAML: a model file, with a surface."""
    stops = _of("piezod.config.model_file:load_model")(MODEL).model_dump()
    common = {key: value for key, value in stops.items() if "_stop_" not in key}
    coefficients = (0.8, *(0.005,) * 23)
    fields = {"method": "surface", "surface_coefficients": coefficients}
    made = _of("piezod.config.model_file:ModelFile").model_validate(common | fields)
    good = _of("piezod.config.model_file:dump_model")(made).encode()
    return Reader(_of("piezod.control.law.model_files:read_model"), good, _refusals("ConfigError"))


def response() -> Reader:
    """YAML: a response file."""
    good = _shipped("responses/simulated-stack.yaml")
    return Reader(_of("piezod.config.response_file:load_response"), good, _refusals("ConfigError"))


def table() -> Reader:
    """YAML: a table file."""
    module = import_module("piezod.config.table_file")
    made = module.TableFile(
        created_at="2026-11-21",
        created_by="piezod",
        axis="x",
        waveform="scan",
        device=module.DeviceIdentity(maker="Acme", model="A1", serial="7"),
        model_sha256="0a" * 32,
        interval_ns=5000,
        sensor_delay_s=1e-4,
        rest_v=0.0,
        passes="pass 3",
        error_max_pct=0.5,
        error_rms_pct=0.2,
        command_um=(0.0, 5.5, 0.0),
        wanted_um=(0.1, 5.4, 0.1),
        drive_v=(0.0, 40.25, 0.0),
    )
    good = module.dump_table(made).encode()
    return Reader(module.load_table, good, _refusals("ConfigError"))


def groups() -> Reader:
    """YAML: the groups of a machine."""
    good = b"groups:\n  scanner: [fast, slow]\n  all: [fast, slow, focus]\n"
    return Reader(_of("piezod.messages.groups:load_groups"), good, _refusals("ConfigError"))


def drive() -> Reader:
    """YAML: the drive of an identification."""
    good = _shipped("experiments/identify.yaml")
    return Reader(_of("piezod.experiment.live.drive:read_drive"), good, _refusals("ConfigError"))


def wave() -> Reader:
    """YAML: a waveform for `piezod wave`."""
    good = (
        b"command_um:\n  axes:\n"
        b"    x: {kind: sine, low: 2, high: 10, frequency_hz: 2}\n"
        b"    y: {kind: points, points: [[0, 1], [0.5, 3.5], [1, 1]]}\nduration_s: 5\n"
    )
    return _document("piezod.config.commands:WaveFile", good)


def group_wave() -> Reader:
    """YAML: waveforms for the stages of a group."""
    good = (
        b"stages:\n"
        b"  fast: {kind: triangle, low: 2, high: 10, frequency_hz: 2}\n"
        b"  slow: {axes: {x: {kind: sine, low: 0, high: 1, frequency_hz: 0.1}}}\nduration_s: 5\n"
    )
    return _document("piezod.messages.groups:GroupWaveFile", good)


def group_play() -> Reader:
    """YAML: tables for the stages of a group."""
    good = b"stages:\n  fast: {drive_v: [0, 1, 2.5, 1], interval_s: 5.0e-6, cycles: 3}\n"
    return _document("piezod.messages.groups:GroupPlayFile", good)


def play() -> Reader:
    """YAML: a waveform for `piezod play`."""
    good = (
        b"name: scan\ncommand_um: {kind: sine, low: 2, high: 10, frequency_hz: 20}\n"
        b"reference: a paper\nreference_pct: {max: 0.5}\n"
    )
    return _document("piezod.config.play:WaveConfig", good)


def points() -> Reader:
    """CSV: the points of a waveform."""
    read, good = _of("piezod.config.files:read_points"), b"t_s,x_um,y_um\n0,1.5,2\n0.25,-1e-2,3\n"
    return Reader(lambda path: read(path, "x_um"), good, (ValueError,))


def body() -> Reader:
    """JSON: the body of a request, then the request."""
    loads, adapter = _of("piezod.daemon.service.route:loads"), _of("pydantic:TypeAdapter")
    request = adapter(_of("piezod.messages.requests:Request"))
    refusals = (_of("piezod.daemon.service.answers:BadJsonError"), _of("pydantic:ValidationError"))
    good = b'{"kind": "goto", "position_um": 12.5, "speed_um_per_s": 190.0}'
    return Reader(
        lambda path: request.validate_python(loads(path.read_bytes()), strict=True), good, refusals
    )


def parameters() -> Reader:
    """JSON: the stored parameters of a stage."""
    module = import_module("piezod.daemon.stores.parameter_document")
    axes = {"x": module.AxisParameters(model=None, zero_um=1.5)}
    document = module.ParameterDocument(
        sequence=3, stage="made up", saved_at="2026-11-21", saved_by="somebody", axes=axes
    )
    return Reader(
        lambda path: module.decode(path.read_bytes()),
        module.encode(document),
        _refusals("DataError"),
    )


def record() -> Reader:
    """CSV and whatever else a record of drive and position may be."""
    samples = (f"{k / 100},{k % 7},{k % 5 / 3}\n" for k in range(12))
    good = ("t_s,drive_v,position_um\n" + "".join(samples)).encode()
    read = _of("piezod.reading.record:read_record")
    return Reader(lambda path: read(path, min_samples=10), good, _refusals("DataError"))


def sheet() -> Reader:
    """.xlsx: a record of drive and position."""
    return _format("a.xlsx")


def arrays() -> Reader:
    """.npz: a record of drive and position."""
    return _format("a.npz")


def matlab() -> Reader:
    """.mat: a record of drive and position."""
    return _format("struct.mat")


def labview() -> Reader:
    """.tdms: a record of drive and position."""
    return _format("a.tdms")


def parquet() -> Reader:
    """.parquet: a record of drive and position."""
    return _format("a.parquet")


def foreign() -> Reader:
    """HDF5 of another program: a record of drive and position."""
    return _format("a.h5")


def _format(name: str) -> Reader:
    good = _written(import_module("tests.reading.writers").WRITERS[name])
    read = _of("piezod.reading.record:read_record")
    return Reader(read, good, (*_refusals("DataError"), OSError))


def result() -> Reader:
    """HDF5: the results of an experiment."""
    recording = import_module("piezod.records.experiment_result")
    columns = {name: np.arange(3.0) for name in recording.COLUMN_NAMES}
    run = recording.Recording(
        "x", "case 1", "adaptive", "made up", metrics={"a_pct": 1.0}, **columns
    )
    made = recording.ExperimentResult(
        title="made up",
        recordings=(run,),
        identifications=(),
        configuration="title: made up\n",
        versions={"piezod": "1"},
        seed=1,
        rate_hz=100.0,
        warnings=(),
    )
    good = _written(lambda path: _of("piezod.records.experiment_file:write_hdf5")(path, made))
    read = _of("piezod.records.experiment_file:read_hdf5")
    return Reader(read, good, (*_refusals("DataError"), OSError))


def recording() -> Reader:
    """HDF5: a recording of a stage, read whole and viewed."""
    made = import_module("tests.records.telemetry")
    writer = _of("piezod.records.recording.writer:TelemetryWriter")
    read = _of("piezod.records.recording.reader:read_telemetry")
    view = _of("piezod.records.view:RecordingView")

    def write(path: Path) -> None:
        with writer(path, made.header(), made.record_dtype()) as file:
            file.append(made.records(0, 40))

    def look(path: Path) -> None:
        read(path)
        viewed = view(path)
        try:
            viewed.view("axis_x/position_um", points=5)
        finally:
            viewed.close()

    # With the flag of a writer in the first bytes, HDF5 waits for hours until checksums fit.
    return Reader(look, _written(write), (*_refusals("DataError"), OSError), kept=48)


def _document(model: str, good: bytes) -> Reader:
    """Return the reader of a YAML file with the fields of a model."""
    load, validate = (
        _of("piezod.config.yaml_loader:load_yaml"),
        _of("piezod.config.validate:validate"),
    )
    fields, context = _of(model), _of("piezod.config.fields:Context")
    return Reader(
        lambda path: validate(load(path), fields, context(path.parent)),
        good,
        _refusals("ConfigError"),
    )


def _shipped(name: str) -> bytes:
    """Return a file of the configuration in which the names of other files are absolute."""
    path = ROOT / "config" / name
    text = path.read_text(encoding="utf-8")
    return text.replace(" models/", f" {path.parent}/models/").encode()


def _written(write: Callable[[Path], object]) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "good.h5"
        write(path)
        return path.read_bytes()


READERS: Final[dict[str, Callable[[], Reader]]] = {
    made.__name__: made
    for made in (
        configuration, experiment, model, surface, response, table, groups, drive, wave, group_wave,
        group_play, play, points, body, parameters, record, result, recording, sheet, arrays,
        matlab, labview, parquet, foreign,
    )
}  # fmt: skip
